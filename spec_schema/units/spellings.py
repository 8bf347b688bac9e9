"""Finds the intended unit of words, other letters and typing errors."""

import re
from typing import NamedTuple

from spec_schema.diagnostics.suggest import nearest
from spec_schema.units.table import PREFIXES, UNIT_ROWS
from spec_schema.units.unit import unit_symbol

_TWICE = re.compile(r"(.)\1")
_POWER = re.compile(r"(\D+)([2-4])")
_NO_UNIT = frozenset(["adim", "dimensionless", "none", "None", "unitless"])
_SPELLINGS = {
    word: unit
    for words, unit in (
        ("°", "deg"),
        ("°C celsius Celsius", "degC"),
        ("°F fahrenheit Fahrenheit", "degF"),
        ("Nm", "N*m"),
        ("Upm UPM upm", "rpm"),
        ("revs revolution revolutions turn turns Umdr Umdrehungen", "rev"),
        ("kmh kmph", "km/h"),
        ("mps", "m/s"),
        ("metre meter metres meters", "m"),
        ("sec secs second seconds", "s"),
        ("msec msecs millis millisecond milliseconds", "ms"),
        ("usec usecs micros microsecond microseconds", "us"),
        ("nanosecond nanoseconds", "ns"),
        ("mins minute minutes", "min"),
        ("hr hrs hour hours", "h"),
        ("day days", "d"),
        ("degs degree degrees", "deg"),
        ("radian radians", "rad"),
        ("kelvin Kelvin", "K"),
        ("newton Newton newtons", "N"),
        ("volt Volt volts Volts", "V"),
        ("amp ampere Ampere amps", "A"),
        ("watt Watt watts", "W"),
        ("joule Joule joules", "J"),
        ("pascal Pascal", "Pa"),
        ("bars", "bar"),
        ("ohms Ohms", "ohm"),
        ("inch inches", "in"),
        ("foot feet", "ft"),
        ("lpm", "L/min"),
        ("gram grams", "g"),
        ("kgs kilogram kilograms", "kg"),
        ("litre liter litres liters ltr", "L"),
        ("hertz Hertz", "Hz"),
        ("percent", "%"),
        ("knot knots kts", "kn"),
        ("Amp Amps amperes", "A"),
        ("henry henries", "H"),
        ("siemens", "S"),
        ("tesla", "T"),
        ("pct prozent Prozent", "%"),
        ("sek Sek sekunde Sekunde Sekunden", "s"),
        ("Minuten", "min"),
        ("Stunde Stunden", "h"),
        ("Tage", "d"),
        ("ccm", "cm^3"),
        # no product of henries and pascals
        ("HPa", "hPa"),
    )
    for word in words.split()
}

_PRODUCTS = {
    "Nm": "N*m",
    "NM": "nmi",
    "kNm": "kN*m",
    "MNm": "MN*m",
    "Ns": "N*s",
    "As": "A*s",
    "Vs": "V*s",
    "Ws": "W*s",
    "VA": "V*A",
    "kVA": "kV*A",
    "MVA": "MV*A",
    "Pas": "Pa*s",
    "MT": "t",
}
"""Symbols that files in capital letters join without a sign; `NM` are nautical miles as well, `MT`
metric tons."""
_CONFUSED = {
    "C": ("degC",),
    "F": ("degF",),
    "deg": ("degC", "degF"),
    "g": ("g0",),
    "kg": ("kgf",),
    "lb": ("lbf",),
    "nm": ("N*m", "nmi"),
    "m": ("min",),
    "min": ("arcmin",),
    "s": ("arcsec",),
    "sr": ("s",),
    "kt": ("kn",),
    "kP": ("kgf",),
}
_DOUBTFUL = {
    word: unit
    for words, unit in (
        # degrees or gradians in German, normal litres, American grams, horsepower, metric tons
        ("grad Grad GRAD", "deg"),
        ("NL Nl", "L"),
        ("gm Gm GM", "g"),
        ("Gmol", "mol"),
        ("cc cC Cc CC", "cm^3"),
        ("mt nt ut pt ct dt ht", "t"),
        # tools that write a capital letter first
        ("Mm", "mm"),
        ("Ms", "ms"),
        ("Mg", "mg"),
        ("Ml", "mL"),
        ("Mrad", "mrad"),
        ("Mmol", "mmol"),
        ("Mbar", "mbar"),
        ("Mcd", "mcd"),
        ("MAh", "mAh"),
        ("cv cV Cv CV", "PS"),
        # hours, also in German; calories of food; standard gravity; differences
        ("hs std Std STD", "h"),
        ("Cal", "kcal"),
        ("gn", "g0"),
        ("dV", "V"),
        ("dA", "A"),
        # feet, and a drag coefficient that is none of coulombs by days
        ("Ft", "ft"),
        ("Cd", "cd"),
        ("nm^3 nm3 nm³ Nm^3 Nm3 Nm³ NM^3 NM3 NM³", "m^3"),
    )
    for word in words.split()
}
"""Texts that are units by their letters, gigaradians and nanolitres, which nobody means; and the
unit that they may mean."""
_MEANT_IN_SPECS = frozenset(["Mg", "dt"])
"""Tonnes and decitonnes, in which some people measure: a spec means them, a file may not."""
_DOUBT = re.compile(rf"(?<![^\W\d_])(?:{'|'.join(map(re.escape, _DOUBTFUL))})(?![^\W_])")
_USUAL = {
    "da": ("N", "Pa"),
    "f": ("A", "C", "F", "J", "T", "m", "mol", "s"),
    "c": ("Gy", "L", "N", "P", "St", "bar", "g", "l", "m", "s"),
    "d": ("L", "N", "Pa", "S", "bar", "g", "l", "m"),
    "h": ("L", "Pa", "l"),
    "G": ("Bq", "Hz", "J", "N", "Pa", "W", "Wh", "cal", "eV", "ohm", "Ω"),
    "T": ("Bq", "Hz", "J", "W", "Wh", "eV", "ohm", "Ω"),
}
"""Units with their usual prefixes; unusual combinations, such as terametres, need exact
spelling.
"""
_OFTEN_MEGA = frozenset(["MPa", "MHz", "MW", "MN", "MJ", "MWh", "MeV", "Mohm", "MΩ"])
_NEVER_MEGA = frozenset(["m", "s", "rad", "mol", "bar", "Ah"])
"""Units of which devices use thousandths but never millions."""


class Collision(NamedTuple):
    """A unit that is probably intended as another one: `Grad` of size `1e+09 rad`, meant as deg."""

    start: int
    symbol: str
    size: str
    meant: str


def meant_symbol(symbol: str) -> str | None:
    """The unambiguous unit of a symbol in files."""
    if symbol in _SPELLINGS:
        return _SPELLINGS[symbol]
    # `Sec`, `Liter`
    if len(symbol) > 2 and symbol == symbol.capitalize() and symbol.lower() in _SPELLINGS:
        return _SPELLINGS[symbol.lower()]
    # `s2` and `s²`, which is normalised to it
    if (power := _POWER.fullmatch(symbol)) and unit_symbol(power[1]) is not None:
        return f"{power[1]}^{power[2]}"
    if len(symbol) == 1 or _slips(symbol) or symbol in _DOUBTFUL:
        return None
    if symbol == symbol.upper():
        readings = readings_of_capitals(symbol)
        return readings[0] if len(readings) == 1 else None
    alike = _other_case(symbol)
    if not alike and _cases(symbol):  # `Th` is no product, as it is no terahenry
        return None
    # `Mpa` are megapascals; `mpa` may be, and millipascals as well, and `Mv` millivolts
    mega = [
        unit
        for unit in alike
        if unit[0] == symbol[0]
        and symbol[0].isupper()
        and (symbol[0] != "M" or unit in _OFTEN_MEGA)
    ]
    # `Nm`, `mAh`; without a capital letter it may be a word, as `cmd` is
    exact = [unit for unit in _products(symbol) if unit != unit.lower()] + mega
    readings = _kilo(symbol) or exact or alike
    return readings[0] if len(readings) == 1 else None


def readings_of_capitals(symbol: str) -> list[str]:
    """The units that a symbol in capital letters may mean; the symbol itself first, if it is one.

    `MV` are megavolts or millivolts. `MM` are millimetres: nobody measures in megametres. `PHZ`
    are neither: a prefix P is peta, which no unit here has.
    """
    own = [symbol] if unit_symbol(symbol) is not None else []
    words = {**_SPELLINGS, **_PRODUCTS}
    spelt = [unit for word, unit in words.items() if word.upper() == symbol]
    alike = [unit for unit in _other_case(symbol) if not unit.startswith("p") or unit in UNIT_ROWS]
    never = {f"M{row}" for row in _NEVER_MEGA}
    others = [unit for unit in (*alike, *spelt) if unit not in never]
    return list(dict.fromkeys((*own, *others)))


def guessed_symbol(symbol: str) -> str | None:
    """The known unit most similar to a doubtful symbol; None without one."""
    if symbol in _NO_UNIT:
        return "1"
    if symbol in _DOUBTFUL:
        return _DOUBTFUL[symbol]
    is_capital = symbol == symbol.upper()
    alike = (is_capital and readings_of_capitals(symbol)) or _other_case(symbol)
    same_start = [unit for unit in alike if unit[0] == symbol[0]]
    if is_capital and alike:
        return (_kilo(symbol)[-1:] + same_start + alike)[0]
    slips = _slips(symbol.lower() if is_capital else symbol)
    readings = same_start + _kilo(symbol)[-1:] + slips + _products(symbol) + alike
    if readings:
        return readings[0]
    return nearest(symbol, UNIT_ROWS) if len(symbol) > 2 else None  # any letter is a unit


def is_doubtful(text: str) -> bool:
    """True if a unit is unusual and probably intended as another one: `Grad`."""
    return _DOUBT.search(text) is not None


def collisions(text: str) -> list[Collision]:
    """The units in a text of a spec that nobody measures in, and what they may mean.

    Only symbols that a spec can write, without those that it may well mean.
    """
    found: list[Collision] = []
    for match in _DOUBT.finditer(text):
        symbol = match.group()
        for prefix, factor in PREFIXES.items():
            row = symbol.removeprefix(prefix)
            if symbol.startswith(prefix) and row in UNIT_ROWS and UNIT_ROWS[row].prefixes:
                size = f"{factor:g} {row}"
                found.append(Collision(match.start(), symbol, size, _DOUBTFUL[symbol]))
    return [one for one in found if one.symbol not in _MEANT_IN_SPECS]


def without_doubtful(text: str) -> str:
    """The text with doubtful units replaced by the intended ones: `deg/s` for `Grad/s`."""
    return _DOUBT.sub(lambda found: _DOUBTFUL[found.group()], text)


def without_prefix(symbol: str) -> tuple[str, float] | None:
    """A unit with an unsupported prefix, and the factor: rpm and 1000 for `krpm`."""
    found = [
        (row, PREFIXES[prefix])
        for prefix in ("k", "M", "m")
        for row, of in UNIT_ROWS.items()
        if not of.prefixes and (prefix + row).casefold() == symbol.casefold()
    ]
    exact = [(row, scale) for row, scale in found if symbol.endswith(row) and symbol[0] in PREFIXES]
    exact = [(row, scale) for row, scale in exact if PREFIXES[symbol[0]] == scale]
    chosen = exact or found
    return chosen[0] if len(chosen) == 1 else None


def confused_symbols(symbol: str) -> list[str]:
    """Units for which the symbol of another one is often written: `C` for degrees, `lb` for lbf."""
    return [*_CONFUSED.get(symbol, ()), *_other_case(symbol)]


def _kilo(symbol: str) -> list[str]:
    """The units with kilo that begin with a K here: no file joins kelvins to units so."""
    return [unit for unit in _other_case(symbol) if unit[0] == "k" and symbol[0] == "K"]


def _slips(symbol: str) -> list[str]:
    """The word without a plural s or a doubled letter; not `Pa` for `Pas`."""
    plural = symbol.removesuffix("s")
    row = UNIT_ROWS.get(plural)
    is_whole = len(plural) > 2 or (row is not None and not row.prefixes)
    is_plural = plural != symbol and is_whole and unit_symbol(plural) is not None
    once = _TWICE.sub(r"\1", symbol)
    # `ms` is a unit, `ss` a slip of the finger
    is_twice = once != symbol and unit_symbol(once) is not None
    return [plural] * is_plural + [once] * is_twice


def _other_case(symbol: str) -> list[str]:
    """The symbols that differ from this one in small and capital letters alone, without such as
    nobody measures in: terametres, nanotonnes."""
    return [prefix + row for prefix, row in _cases(symbol) if _is_usual(prefix, row)]


def _cases(symbol: str) -> list[tuple[str, str]]:
    """The prefixes and rows that spell this symbol, in small and capital letters of any kind."""
    rows = [("", row) for row in UNIT_ROWS if row.casefold() == symbol.casefold()]
    return rows + [
        (prefix, row)
        for prefix in PREFIXES
        for row, of in UNIT_ROWS.items()
        if of.prefixes and (prefix + row).casefold() == symbol.casefold()
    ]


def _is_usual(prefix: str, row: str) -> bool:
    if row == "t":
        return prefix in ("", "k", "M")
    return row in _USUAL.get(prefix, (row,))


def _products(symbol: str) -> list[str]:
    """Two units without `*` between them, as in `As`."""
    ends = range(1, len(symbol))
    pairs = [(symbol[:end], symbol[end:]) for end in ends]
    return [f"{a}*{b}" for a, b in pairs if unit_symbol(a) and unit_symbol(b)]
