"""The table of unit symbols; sources: the SI brochure (2019) and NIST SP 811, appendix B."""

import math
from collections.abc import Mapping

from spec_schema.late_dataclass import dataclass

BASE_SYMBOLS = ("m", "kg", "s", "A", "K", "mol", "cd", "rad", "dB")

# Longest spelling first: `da` must be tried before `d`. `μ` is U+03BC, which NFKC makes of `µ`.
PREFIXES: Mapping[str, float] = {
    "da": 1e1,
    "f": 1e-15,
    "p": 1e-12,
    "n": 1e-9,
    "u": 1e-6,
    "μ": 1e-6,
    "m": 1e-3,
    "c": 1e-2,
    "d": 1e-1,
    "h": 1e2,
    "k": 1e3,
    "M": 1e6,
    "G": 1e9,
    "T": 1e12,
}


@dataclass(frozen=True)
class UnitRow:
    """One symbol: exponents of base units, scale and offset to SI, whether it takes prefixes."""

    exponents: Mapping[str, int]
    scale: float = 1.0
    offset: float = 0.0
    prefixes: bool = False


def _si(scale: float = 1.0, **exponents: int) -> UnitRow:
    return UnitRow(exponents, scale, prefixes=True)


def _other(scale: float, offset: float = 0.0, **exponents: int) -> UnitRow:
    return UnitRow(exponents, scale, offset)


_POUND = 0.45359237
_GRAVITY = 9.80665
_FOOT = 0.3048

UNIT_ROWS: Mapping[str, UnitRow] = {
    # Base and coherent derived units.
    "m": _si(m=1),
    "g": _si(1e-3, kg=1),
    "s": _si(s=1),
    "A": _si(A=1),
    "K": _si(K=1),
    "mol": _si(mol=1),
    "cd": _si(cd=1),
    "rad": _si(rad=1),
    "sr": _si(rad=2),
    "Hz": _si(s=-1),
    "N": _si(m=1, kg=1, s=-2),
    "Pa": _si(m=-1, kg=1, s=-2),
    "J": _si(m=2, kg=1, s=-2),
    "W": _si(m=2, kg=1, s=-3),
    "C": _si(s=1, A=1),
    "V": _si(m=2, kg=1, s=-3, A=-1),
    "F": _si(m=-2, kg=-1, s=4, A=2),
    "Ω": _si(m=2, kg=1, s=-3, A=-2),
    "ohm": _si(m=2, kg=1, s=-3, A=-2),
    "S": _si(m=-2, kg=-1, s=3, A=2),
    "Wb": _si(m=2, kg=1, s=-2, A=-1),
    "T": _si(kg=1, s=-2, A=-1),
    "H": _si(m=2, kg=1, s=-2, A=-2),
    "lm": _si(cd=1, rad=2),
    "lx": _si(m=-2, cd=1, rad=2),
    "Bq": _si(s=-1),
    "Gy": _si(m=2, s=-2),
    "kat": _si(mol=1, s=-1),
    # Accepted beside the SI.
    "L": _si(1e-3, m=3),
    "l": _si(1e-3, m=3),
    "t": _si(1e3, kg=1),
    "bar": _si(1e5, m=-1, kg=1, s=-2),
    "eV": _si(1.602176634e-19, m=2, kg=1, s=-2),
    "Wh": _si(3600.0, m=2, kg=1, s=-2),
    "Ah": _si(3600.0, s=1, A=1),
    "min": _other(60.0, s=1),
    "h": _other(3600.0, s=1),
    "d": _other(86400.0, s=1),
    "ha": _other(1e4, m=2),
    "au": _other(149597870700.0, m=1),
    "degC": _other(1.0, 273.15, K=1),
    # Angle and ratio.
    "deg": _other(math.pi / 180, rad=1),
    # gradian: a right angle has 100
    "gon": _si(math.pi / 200, rad=1),
    "arcmin": _other(math.pi / 10800, rad=1),
    "arcsec": _other(math.pi / 648000, rad=1),
    "rev": _other(2 * math.pi, rad=1),
    # an angle a second, not a count: 1 rpm converts to rad/s
    "rpm": _other(2 * math.pi / 60, s=-1, rad=1),
    "rps": _other(2 * math.pi, s=-1, rad=1),
    "%": _other(1e-2),
    "ppm": _other(1e-6),
    # a level, 20 log10 of a ratio of amplitudes; no number, so that it is no factor in formulas
    "dB": _other(1.0, dB=1),
    # Engineering and customary units.
    "atm": _other(101325.0, m=-1, kg=1, s=-2),
    "mmHg": _other(133.322387415, m=-1, kg=1, s=-2),
    "psi": _other(_POUND * _GRAVITY / (_FOOT / 12) ** 2, m=-1, kg=1, s=-2),
    "kgf": _other(_GRAVITY, m=1, kg=1, s=-2),
    "lbf": _other(_POUND * _GRAVITY, m=1, kg=1, s=-2),
    "lb": _other(_POUND, kg=1),
    "oz": _other(_POUND / 16, kg=1),
    "in": _other(_FOOT / 12, m=1),
    "ft": _other(_FOOT, m=1),
    "yd": _other(3 * _FOOT, m=1),
    "mi": _other(5280 * _FOOT, m=1),
    "nmi": _other(1852.0, m=1),
    "kn": _other(1852.0 / 3600, m=1, s=-1),
    "mph": _other(5280 * _FOOT / 3600, m=1, s=-1),
    "kph": _other(1000.0 / 3600, m=1, s=-1),
    # not `g`, which is the gram
    "g0": _other(_GRAVITY, m=1, s=-2),
    "hp": _other(550 * _FOOT * _POUND * _GRAVITY, m=2, kg=1, s=-3),
    "PS": _other(75 * _GRAVITY, m=2, kg=1, s=-3),
    "cal": _si(4.184, m=2, kg=1, s=-2),
    "Btu": _other(1055.05585262, m=2, kg=1, s=-2),
    # 0 °F lies 459.67 degrees of Fahrenheit above absolute 0
    "degF": _other(5 / 9, 459.67 * 5 / 9, K=1),
    # of differences of degF
    "degR": _other(5 / 9, K=1),
    "gal": _other(231 * (_FOOT / 12) ** 3, m=3),
    "St": _si(1e-4, m=2, s=-1),
    "P": _si(0.1, m=-1, kg=1, s=-1),
}
