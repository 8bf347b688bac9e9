"""Represents units: their symbols, exponents of SI base units and of angle, scale, text.

Sources of the table: the SI brochure (2019) and NIST SP 811, appendix B.
"""

import math
from collections.abc import Mapping
from dataclasses import field, replace
from decimal import Decimal
from fractions import Fraction
from functools import lru_cache
from typing import Literal, TypeAlias

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
    """One symbol of the table of units: exponents of SI base units, scale, offset, and if it takes
    prefixes.
    """

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


Rational: TypeAlias = int | Fraction
"""An integer if possible, because additions of integers are much faster."""

Exponents: TypeAlias = tuple[Rational, ...]
_ANGLE = BASE_SYMBOLS.index("rad")
_LEVEL: Exponents = tuple(int(symbol == "dB") for symbol in BASE_SYMBOLS)
_NO_EXPONENTS: Exponents = (0,) * len(BASE_SYMBOLS)
# Products of float scales reach the same unit by different roads (km/h, m/s); one part in 1e12 is
# far above their rounding and far below any two units that differ.
_SCALE_TOLERANCE = 1e-12
_LARGEST_SCALE = 1e300
DIGITS = 15
"""Number of decimal digits that a float preserves; more digits mean an approximation."""


class UnitError(ValueError):
    """A text that is no unit; `start` and `end` are the offsets of the wrong part.

    `meant` is the unit that is certainly intended, `replacement` also a probable one; else `repair`
    shows an example. With the example the number is `scale` times as large.
    """

    def __init__(
        self,
        message: str,
        start: int,
        end: int,
        *,
        meant: str | None = None,
        guess: str | None = None,
        example: str | None = None,
        scale: float = 1.0,
    ) -> None:
        super().__init__(message)
        self.message = message
        self.start = start
        self.end = end
        self.meant = meant
        self.replacement = meant or guess
        self.repair = self.replacement or example
        self.scale = scale


@dataclass(frozen=True)
class Unit:
    """A unit: value_in_SI = scale * value + offset.

    `exponents` are those of m, kg, s, A, K, mol, cd and of rad, which is tagged but counts as 1 in
    dimension checks. `factors` are (symbol, exponent) pairs from which the text is made.
    """

    exponents: Exponents
    scale: float
    offset: float = 0.0
    factors: tuple[tuple[str, Rational], ...] = field(default=(), compare=False)

    @property
    def text(self) -> str:
        """Canonical text: `N*m/rad`, `m/s^2`, `1/s`; dimensionless is `1`."""
        above = [_power_text(symbol, power) for symbol, power in self.factors if power > 0]
        below = [_power_text(symbol, -power) for symbol, power in self.factors if power < 0]
        return "/".join(["*".join(above) or "1", *below])

    def __str__(self) -> str:
        return self.text

    def __hash__(self) -> int:
        # every node's type is hashed when a graph is built, and hashing a Fraction is slow
        # equal units have equal scales, and units that differ in dimension alone are few
        return hash((self.scale, self.offset))

    def __mul__(self, other: "Unit") -> "Unit":
        both = zip(self.exponents, other.exponents, strict=True)
        exponents = tuple(_reduced(a + b) for a, b in both)
        factors = _merge(self.factors + other.factors)
        return Unit(exponents, _within_floats(self.scale * other.scale), 0.0, factors)

    def __truediv__(self, other: "Unit") -> "Unit":
        return self * other.power(-1)

    def power(self, exponent: Rational) -> "Unit":
        """The unit raised to a rational power; a temperature loses its offset (degC^2 is K^2)."""
        exponents = tuple(_reduced(e * exponent) for e in self.exponents)
        factors = _merge(
            tuple((symbol, _reduced(power * exponent)) for symbol, power in self.factors)
        )
        return Unit(exponents, _power(self.scale, float(exponent)), 0.0, factors)

    def root(self, degree: int) -> "Unit":
        """The unit whose `degree`-th power is this one."""
        return self.power(Fraction(1, degree))

    @property
    def angle(self) -> Rational:
        """The exponent of rad, which counts as 1 in dimension checks."""
        return self.exponents[_ANGLE]

    def same_dimension(self, other: "Unit") -> bool:
        """True if the SI exponents agree; angle is ignored, so `1/s` is comparable with `rad/s`."""
        return _without_angle(self.exponents) == _without_angle(other.exponents)

    @property
    def is_level(self) -> bool:
        """True for decibels: 20 log10 of a ratio (ISO 80000-3, field quantities)."""
        return self.exponents == _LEVEL

    def converts_to(self, other: "Unit") -> bool:
        """True if values convert: units of one dimension, or decibels and ratios."""
        if self.same_dimension(other):
            return True
        number = ONE.same_dimension(other) if self.is_level else ONE.same_dimension(self)
        return number and (self.is_level or other.is_level)

    def same_as(self, other: "Unit") -> bool:
        """True if values in both units mean the same: `N*m` and `J`, `rad/s` and `1/s`."""
        return (
            self.same_dimension(other)
            and math.isclose(self.scale, other.scale, rel_tol=_SCALE_TOLERANCE)
            and math.isclose(self.offset, other.offset, rel_tol=_SCALE_TOLERANCE)
        )

    @property
    def coherent(self) -> str:
        """The text of the coherent SI unit of this dimension: `H` for `uH`, `m/s` for `km/h`."""
        # without prefixes, where that is enough; else of base units
        if self.is_level:
            return ONE.text
        for name in (_without_prefix, _base_symbols):
            unit = name(self)
            if unit is not None and unit.scale == 1.0 and unit.offset == 0.0:
                return unit.text
        return self.text

    @property
    def difference(self) -> "Unit":
        """The unit of the difference of two values: K of degC, degR of degF, else the unit itself.

        20 degC - 15 degC is 5 K, and 20 degC + 5 K is 25 degC.
        """
        if self.offset == 0.0:
            return self
        found = unit_symbol("K" if self.scale == 1.0 else "degR")
        assert found is not None
        return found

    def prefixed(self, exponent: int) -> "Unit | None":
        """This unit times 10^exponent, written with another prefix: N for kN and −3.

        None if no prefix fits.
        """
        if self.offset:
            return None
        scale = _exact(self.scale) * Fraction(10) ** exponent
        for index, (symbol, power) in enumerate(self.factors):
            if power != 1:
                continue
            for other in _other_prefixes(symbol):
                found = ONE
                for place, (factor, of) in enumerate(self.factors):
                    unit = unit_symbol(other if place == index else factor)
                    assert unit is not None, "factors are symbols"
                    found = found * (unit if of == 1 else unit.power(of))
                if math.isclose(found.scale, scale, rel_tol=_SCALE_TOLERANCE):
                    return found
        return None

    def in_si(self, value: float) -> float:
        """The value in SI units, rounded once: 10 us is 1e-05 s, although 10 · 1e-06 is not in
        floats.
        """
        return nearest_float(meant(value) * _exact(self.scale)) + self.offset

    def convert(self, value: float, target: "Unit", *, is_distance: bool = False) -> float:
        """A value converted from this unit to `target`; ValueError for another dimension.

        With `is_distance` it is a difference of two values, and offsets are ignored. Infinite on
        overflow.
        """
        if not self.same_dimension(target) and not is_distance and self.converts_to(target):
            return self._convert_level(value, target)
        if not self.same_dimension(target):
            message = f"{self.text} does not convert to {target.text}"
            raise ValueError(message)
        # to the bit: a unit written in another way must not round the number
        if self.same_as(target):
            return value
        if not math.isfinite(value):
            return value
        line = self.line_to(target)
        return nearest_float(line.factor * meant(value) + (0 if is_distance else line.summand))

    def _convert_level(self, value: float, target: "Unit") -> float:
        """Decibels of a ratio, or the ratio of decibels; NaN for a negative ratio, -∞ for 0."""
        if self.is_level:
            return 10.0 ** (value / 20.0) / target.scale
        ratio = self.in_si(value)
        if ratio > 0.0:
            return 20.0 * math.log10(ratio)
        return -math.inf if ratio == 0.0 else math.nan

    def line_to(self, target: "Unit") -> "Line":
        """The linear map from values in this unit to values in `target`."""
        if self.same_as(target):
            return UNCHANGED
        if self.is_level != target.is_level:
            if self.is_level:
                return Line(Fraction(1), Fraction(0), "from", 1 / _exact(target.scale))
            return Line(_exact(self.scale), Fraction(0), "to")
        scale = _exact(target.scale)
        shift = _exact(self.offset) - _exact(target.offset)
        return Line(_exact(self.scale) / scale, shift / scale)

    def factor_to(self, target: "Unit") -> float:
        """The factor from differences in this unit to differences in `target`."""
        if not self.same_dimension(target):
            message = f"{self.text} does not convert to {target.text}"
            raise ValueError(message)
        return nearest_float(_exact(self.scale) / _exact(target.scale))


@dataclass(frozen=True)
class Line:
    """A linear conversion between units: factor · x + summand, in exact fractions.

    `level` converts from or to decibels in addition.
    """

    factor: Fraction
    summand: Fraction
    level: Literal["from", "to"] | None = None
    """`to` decibels: 20 log10 of the line. `from` them: `ratio` · 10^(line / 20)."""
    ratio: Fraction = Fraction(1)

    def after(self, scale: float, offset: float) -> "Line":
        """The conversion that first computes scale · x + offset, then this one."""
        return replace(
            self,
            factor=self.factor * _exact(scale),
            summand=self.factor * _exact(offset) + self.summand,
        )


UNCHANGED = Line(Fraction(1), Fraction(0))
ONE = Unit(_NO_EXPONENTS, 1.0)


def unit_symbol(symbol: str) -> Unit | None:
    """The unit of one symbol, possibly with a prefix; None if there is none."""
    row = UNIT_ROWS.get(symbol)
    if row is not None:
        return _unit_of_row(symbol, row, 1.0)
    for prefix, scale in PREFIXES.items():
        row = UNIT_ROWS.get(symbol.removeprefix(prefix)) if symbol.startswith(prefix) else None
        if row is not None and row.prefixes:
            return _unit_of_row(symbol, row, scale)
    return None


def _unit_of_row(symbol: str, row: UnitRow, prefix_scale: float) -> Unit:
    exponents = tuple(row.exponents.get(base, 0) for base in BASE_SYMBOLS)
    return Unit(exponents, prefix_scale * row.scale, row.offset, ((symbol, 1),))


def _without_prefix(unit: Unit) -> Unit | None:
    found = ONE
    for symbol, power in unit.factors:
        factor = unit_symbol(_row_of(symbol))
        assert factor is not None, "factors are symbols"
        found = found * factor.power(power)
    return None if found.text == unit.text else found


def _row_of(symbol: str) -> str:
    rows = (symbol, *(symbol.removeprefix(p) for p in PREFIXES if symbol.startswith(p)))
    # `min` is no milli-inch: a symbol of its own keeps all of it
    return next((name for name in rows if name in UNIT_ROWS), symbol)


def _other_prefixes(symbol: str) -> list[str]:
    """`N` and all of its prefixes for `kN`; none for `min`, which takes none."""
    row = _row_of(symbol)
    return [row, *(prefix + row for prefix in PREFIXES)] if UNIT_ROWS[row].prefixes else []


def _base_symbols(unit: Unit) -> Unit | None:
    found = ONE
    for symbol, power in zip(BASE_SYMBOLS, unit.exponents, strict=True):
        base = unit_symbol(symbol)
        assert base is not None
        found = found * base.power(power)
    return found


def _without_angle(exponents: Exponents) -> Exponents:
    return exponents[:_ANGLE] + exponents[_ANGLE + 1 :]


def meant(number: float) -> Fraction:
    """The shortest decimal that rounds to this float; its exact value if that has over 15 digits.

    0.1 is 1/10, not the exact value of the float.
    """
    decimal = Decimal(repr(number))
    is_short = len(decimal.normalize().as_tuple().digits) <= DIGITS
    return Fraction(decimal if is_short else number)


@lru_cache(1024)
def _exact(number: float) -> Fraction:
    """The float as the decimal fraction that it was written as: 1e-6 exactly."""
    return Fraction(Decimal(repr(number)))


def nearest_float(number: Fraction) -> float:
    """The float nearest to an exact number; infinite beyond the largest."""
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def _reduced(number: Rational) -> Rational:
    return number.numerator if number.denominator == 1 else number


def _merge(factors: tuple[tuple[str, Rational], ...]) -> tuple[tuple[str, Rational], ...]:
    powers: dict[str, Rational] = {}
    for symbol, power in factors:
        powers[symbol] = _reduced(powers.get(symbol, 0) + power)
    return tuple((symbol, power) for symbol, power in powers.items() if power)


def _power(scale: float, exponent: float) -> float:
    try:
        return _within_floats(scale**exponent)
    except OverflowError:
        return _LARGEST_SCALE


def _within_floats(scale: float) -> float:
    """Limits the scale of absurd units (eV^-30) to positive finite floats, so that computing cannot
    fail.
    """
    return min(max(scale, 1 / _LARGEST_SCALE), _LARGEST_SCALE)


def _power_text(symbol: str, power: Rational) -> str:
    return symbol if power == 1 else f"{symbol}^{power}"
