"""Reads unit texts such as `m/s^2`, `N*m/rad`, `1/m` and `1`."""

import re
import unicodedata
from collections.abc import Iterator
from itertools import islice, product

from spec_schema.units.spellings import (
    confused_symbols,
    guessed_symbol,
    meant_symbol,
    without_prefix,
)
from spec_schema.units.unit import ONE, Unit, UnitError, unit_symbol

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
    """The unit a text means; UnitError with offsets into `text` when it is not one.

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
    """NFKC for each character alone, so that offsets stay; `µ` becomes `μ`, the ohm sign `Ω`."""
    normal = (unicodedata.normalize("NFKC", character) for character in text.translate(_SIGNS))
    return "".join(new if len(new) == 1 else old for old, new in zip(text, normal, strict=True))
