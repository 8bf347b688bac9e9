"""Parses units such as `m/s^2`, `N*m/rad`, `1/m`, and suggests units for unknown words."""

import re
import unicodedata
from collections.abc import Iterator
from itertools import islice, product
from typing import NamedTuple

from spec_schema.diagnostics.suggest import nearest
from spec_schema.units.unit import ONE, PREFIXES, UNIT_ROWS, Unit, UnitError, unit_symbol

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
    """The unit that another spelling in a data file clearly means, such as `m` for `metre`; None if
    unclear.
    """
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
    """Unusual units in a text of a spec, each with the unit that it probably means."""
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
    """Units that a symbol often means by mistake: `degC` for `C`, `lbf` for `lb`."""
    return [*_CONFUSED.get(symbol, ()), *_other_case(symbol)]


def _kilo(symbol: str) -> list[str]:
    """The units with the prefix kilo that a symbol beginning with a capital K may mean."""
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
    """The usual units that differ from this symbol in upper and lower case only."""
    return [prefix + row for prefix, row in _cases(symbol) if _is_usual(prefix, row)]


def _cases(symbol: str) -> list[tuple[str, str]]:
    """All pairs of prefix and unit that spell this symbol in any upper and lower case."""
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


_LONGEST = 100
_LARGEST_POWER = 24
_MOST_CONFUSED = 256
_TOKEN = re.compile(
    r"\s*(?:(?P<symbol>[A-Za-zͰ-ϿΩ%°][A-Za-z0-9Ͱ-Ͽ%]*)|(?P<power>\^|\*\*)\s*(?P<exponent>[+-]?[0-9]+)?"
    r"|(?P<operator>[*/·])|(?P<one>1)(?![0-9.]))"
)
_PARENTHESES = re.compile(r"\((?P<inside>[^()]*)\)(?!\s*(?:\^|\*\*))")
_OPERATOR = re.compile(r"(?<!\*)[*·](?!\*)|/")
_PRODUCT_DOT = re.compile(r"[^\W\d]\.[^\W\d]")
_TURNS = re.compile(r"(?:r|tr|U)\s*/\s*(?:min|s|sec)\b")
"""Revolutions per time in English, French and German; each letter alone is no unit."""
_POWER_SIGN = re.compile(r"[^\W\d][-\u2212]\d")
"""`s-1` of ISO 80000 and of CF, `s⁻¹`, whose sign NFKC makes a minus sign."""


_SIGNS = str.maketrans("⋅∙•×∕⁄÷º", "···*///°")
"""Signs of other keyboards and fonts."""


def parse_unit(text: str) -> Unit:
    """The unit that a text means. Raises UnitError, with offsets into `text`, for other texts.

    Factors are joined by `*` and `/`, read from left to right; `^` is followed by an integer.
    """
    text = _normalised(text)
    if not text.strip() or len(text) > _LONGEST:
        raise UnitError("a unit looks like `m/s^2`, or `1` for none", 0, len(text))
    # from left to right, each `/` for the one factor behind it: `J/kg/K`, as `J/kg*K` is (J/kg)·K
    unit, position, divide = ONE, 0, False
    expects_factor = True
    while text[position:].strip():
        found = _TOKEN.match(text, position)
        if found is None:
            raise _unreadable(text, position)
        # where the token itself begins, behind the blanks that it was matched with
        start = found.end() - len(found.group().lstrip())
        if found["operator"] and not expects_factor:
            divide, expects_factor = found["operator"] == "/", True
            position = found.end()
            continue
        if found["power"] or found["operator"] or not expects_factor:
            raise _misplaced(found, start)
        factor = ONE if found["one"] else _factor(text, found["symbol"], start, divide)
        position = found.end()
        # looked at ahead of the loop: a power belongs to the factor before it alone
        power = _TOKEN.match(text, position)
        if power is not None and power["power"]:
            factor = factor.power(_exponent(power, position))
            position = power.end()
        unit = _joined(unit, factor, divide)
        divide, expects_factor = False, False
    if expects_factor:
        raise UnitError("a unit is missing after the last `*` or `/`", len(text) - 1, len(text))
    return unit


def confused_units(unit: Unit) -> Iterator[Unit]:
    """Units that may be intended instead: `degC` for `C`, `km/h` for `km/H`."""
    options = [(symbol, *confused_symbols(symbol)) for symbol, _ in unit.factors]
    for symbols in islice(product(*options), _MOST_CONFUSED):
        found = ONE
        for symbol, (_, power) in zip(symbols, unit.factors, strict=True):
            factor = parse_unit(symbol)
            found = _joined(found, factor if power == 1 else factor.power(power), divide=False)
        yield found


def _joined(unit: Unit, factor: Unit, divide: bool) -> Unit:
    if divide:
        return unit / factor
    # A lone `degC` keeps its offset; in a product only differences of temperature make sense.
    return factor if unit == ONE else unit * factor


def _factor(text: str, symbol: str, start: int, divide: bool) -> Unit:
    unit = unit_symbol(symbol)
    if unit is not None:
        return unit
    meant = "rev" if _TURNS.match(text, start) else meant_symbol(symbol)
    if meant is None and (found := without_prefix(symbol)) is not None:
        row, scale = found
        message = f"`{row}` takes no prefix: 1 {symbol} is {scale:g} {row}"
        is_power = text[start + len(symbol) :].lstrip().startswith(("^", "**"))
        scale = 1.0 if is_power else 1 / scale if divide else scale
        raise UnitError(message, start, start + len(symbol), example=row, scale=scale)
    guess = None if meant else guessed_symbol(symbol)
    if divide:
        meant, guess = meant and as_divisor(meant), guess and as_divisor(guess)
    message = f"unknown unit `{symbol}`"
    raise UnitError(message, start, start + len(symbol), meant=meant, guess=guess)


def _exponent(power: re.Match[str], position: int) -> int:
    text = power["exponent"]
    # the length first: an exponent of a million digits is not to be read as a number
    if text is None or len(text) > 3 or abs(int(text)) > _LARGEST_POWER:
        message = f"a power of a unit is an integer of at most {_LARGEST_POWER}"
        raise UnitError(message, position, power.end())
    return int(text)


def _misplaced(found: re.Match[str], start: int) -> UnitError:
    if found["symbol"] or found["one"]:
        return UnitError("two units stand side by side; join them by `*`", start, found.end())
    return UnitError(f"`{found.group().strip()}` has no unit before it", start, found.end())


def _unreadable(text: str, position: int) -> UnitError:
    start = position + len(text[position:]) - len(text[position:].lstrip())
    if text[start] in "()":
        return _grouped(text, start)
    # `N.s`, a product as ISO 80000 prints it; `m^0.5` is none
    before = max(start - 1, 0)
    meant = "*" if _PRODUCT_DOT.match(text, before) else None
    meant = "^-" if _POWER_SIGN.match(text, before) else meant
    if letters := _letters(text[start]):
        meant = as_divisor(letters) if text[:start].rstrip().endswith("/") else letters
    message = f"`{text[start]}` does not belong in a unit"
    # as tables have it for numbers without a unit
    guess = "1" if text.strip() == "-" else None
    return UnitError(message, start, start + 1, meant=meant, guess=guess)


def _letters(character: str) -> str | None:
    """The letters of a single-character unit, as in East Asian files: `mm` for `㎜`."""
    if character in "℃℉":
        return f"deg{'CF'['℃℉'.index(character)]}"
    if not "㍱" <= character <= "㏟":
        return None
    return unicodedata.normalize("NFKC", character).translate(_SIGNS)


def _grouped(text: str, start: int) -> UnitError:
    message = "units have no parentheses: each `/` divides by one"
    group = _PARENTHESES.match(text, start)
    before = text[:start].rstrip()[-1:]
    if group is None or before not in {"", "*", "/", "·"}:
        return UnitError(message, start, start + 1, example="J/kg/K")
    inside = group["inside"]
    if before == "/":
        inside = as_divisor(inside)
    return UnitError(message, start, group.end(), meant=inside.strip())


def as_divisor(text: str) -> str:
    """The factors of a unit after a `/`: `N/m` for `N*m`, because 1/N/m is 1/(N*m)."""
    return _OPERATOR.sub(lambda found: "*" if found.group() == "/" else "/", text)


def _normalised(text: str) -> str:
    """The text with each character normalised (NFKC) alone, so that offsets stay; `µ`
    becomes `μ`.
    """
    normal = (unicodedata.normalize("NFKC", character) for character in text.translate(_SIGNS))
    return "".join(new if len(new) == 1 else old for old, new in zip(text, normal, strict=True))
