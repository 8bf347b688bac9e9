"""Reads units as data loggers spell them: `F [N]`, `F (N)`, `°C`, `MM/S`, a line of units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice, product
from typing import TypeAlias

from spec_schema.diagnostics.source import Span
from spec_schema.units.parser import (
    as_divisor,
    is_doubtful,
    parse_unit,
    readings_of_capitals,
    without_doubtful,
)
from spec_schema.units.unit import Unit, UnitError, unit_symbol

MOST_REPAIRS = 3
"""Maximum number of spelling corrections per unit, such as `°` or `Nm`."""
_SYMBOL = re.compile(r"[^\W\d_¹²³⁰-⁹]+")
_POWER = re.compile(r"(?<=[^\W\d_])(?=[2-4](?!\w))")
_TURNS = re.compile(r"\b(?:U|R|TR)(?=\s*/\s*(?:MIN|S|SEC)\b)")
_MOST_READINGS = 64
_OFTEN_MEGA = frozenset(["MW", "MN", "MJ", "MΩ"])
_ACRONYMS = frozenset(["RPM", "UPM", "PSI", "MPH", "KPH", "LPM", "PPM", "HP", "BTU", "ATM"])
"""Units that are usually written in capitals, even in files with lower-case units such as
`km/h`.
"""


@dataclass(frozen=True, slots=True)
class CapitalUnit:
    """A unit in capital letters, which may be ambiguous.

    `MV` means megavolts, or millivolts from a tool that only writes capitals. The signal's declared
    unit decides, otherwise the user.
    """

    text: str
    readings: tuple[Unit, ...]
    written: Unit | None = None
    """The unit as it is written; None if that is not a unit: `MM`."""
    is_as_written: bool = False
    """True if the file has lower-case letters elsewhere, so that capitals are intended."""

    def fitting(self, declared: Unit) -> tuple[Unit, ...]:
        """The distinct readings that convert to the declared unit: exactly one if it is
        unambiguous.

        A reading equal to `declared` takes precedence, and so does the written unit if the file
        uses lower case.
        """
        found = [unit for unit in self.different if unit.converts_to(declared)]
        own = [unit for unit in found if unit.same_as(declared)]
        if self.is_as_written and self.written in found:
            # `MV` in a file with small letters, of a signal in mV: either may be a slip
            return tuple(dict.fromkeys((self.written, *own)))
        return tuple(own or found)

    @property
    def different(self) -> tuple[Unit, ...]:
        """The distinct readings; L and l, for example, are one reading."""
        found: list[Unit] = []
        for unit in self.readings:
            if not any(map(unit.same_as, found)):
                found.append(unit)
        return tuple(found)

    @property
    def likely(self) -> Unit:
        """The reading to name in messages if no reading fits."""
        return self.written or self.readings[0]


@lru_cache(1024)
def capital_unit(text: str) -> Unit | CapitalUnit | None:
    """The unit of a text in capital letters, or all units that it may mean.

    None for texts with lower-case letters, and if no reading is a unit.
    """
    if not is_capital(text):
        return None
    text = _TURNS.sub("REV", _POWER.sub("^", text))
    symbols = _SYMBOL.findall(text)
    options = [readings_of_capitals(symbol) for symbol in symbols]
    between = _SYMBOL.split(text)
    readings: list[Unit] = []
    for chosen in islice(product(*options), _MOST_READINGS):
        parts = [
            sign + (as_divisor(symbol) if sign.rstrip().endswith("/") else symbol)
            for sign, symbol in zip(between, chosen, strict=False)
        ]
        unit = repaired("".join([*parts, between[-1]]))
        if unit is not None and all(unit.text != other.text for other in readings):
            readings.append(unit)
    if not readings:
        return None
    is_exact = all(unit_symbol(symbol) is not None for symbol in symbols)
    written = repaired(text) if is_exact else None
    # a lone letter such as `M` is most often no unit: it is one where it fits the signal
    if len(readings) == 1 and (written is not None or len(text) > 1):
        return readings[0]
    return CapitalUnit(text, tuple(readings), written)


def is_capital(text: str) -> bool:
    """True if a text has letters and none of them is lower case."""
    return text.upper() == text and text.lower() != text


def keeps_case(text: str, units: Iterable[str], names: Iterable[str]) -> bool:
    """True if capitals in a unit are intended, judging by the file's other units and names.

    Units decide first: `km/h` has lower-case letters, `KM/H` lacks them. Otherwise names with
    lower-case letters decide, but only for units that are common with mega: `MW`, but not `MV`.
    """
    texts = tuple(dict.fromkeys(units))
    has_small = any(text.upper() != text for text in texts)
    lacks_small = any(is_capital(text) and _lacks_small(text) for text in texts)
    if has_small or lacks_small:
        return has_small and not lacks_small
    symbols = (symbol for symbol in _SYMBOL.findall(text) if len(symbol) > 1)
    is_usual = all(symbol in _OFTEN_MEGA for symbol in symbols if symbol.startswith("M"))
    return is_usual and any(name.upper() != name for name in names)


def _lacks_small(text: str) -> bool:
    symbols = set(_SYMBOL.findall(text)) - _ACRONYMS
    lacks = any(unit_symbol(symbol) is None for symbol in symbols)
    return lacks and capital_unit(text) is not None


def repaired(text: str) -> Unit | None:
    """The unit of a text, after corrections of unambiguous spellings; None if it is not a unit."""
    for _ in range(MOST_REPAIRS):
        try:
            return parse_unit(text) if text else None
        except UnitError as error:
            if error.meant is None:
                return None
            # parse_unit knows what was meant, for its messages: the same knowledge reads files
            text = text[: error.start] + error.meant + text[error.end :]
    return None


MISSING = frozenset(("", "na", "n/a", "#n/a", "nan", "null", "-"))
"""Texts that mark a missing value, in lower case."""

# lazy up to the last brackets; what stands in these has none of their kind itself
_INSIDE = r"(?:[^()]|\([^()]*\))*"
"""The text in parentheses, which may contain nested ones, as in `(J/(kg K))`."""
_BRACKETS = re.compile(rf"(.*?)\s*(?:\[([^\[\]]*)\]|\(({_INSIDE})\))\s*", re.DOTALL)
_COLUMN_AND_UNIT = re.compile(rf"(.*\S)(?:\s*\[([^\[\]]*)\]|\s+\(({_INSIDE})\))\s*", re.DOTALL)
_AROUND = re.compile(rf"\[(.*)\]|\(({_INSIDE})\)")
_SUPERSCRIPT = re.compile("(?<!⁻)[²³]")
_DIGITS = {"²": "2", "³": "3"}
_BETWEEN_FACTORS = re.compile(r"(?<=[\w%°])[ .](?=[^\W\d])")
_WHOLE_TEXTS = {
    "-": "1",
    "dimensionless": "1",
    "unitless": "1",
    "degrees_north": "deg",
    "degrees_east": "deg",
}
"""Words of CF and of loggers that are not unit symbols."""
_DEGREES = re.compile(
    r"(?<![a-z])(?:[°º]|deg(?:ree)?s?|grad)[ _.]*(C|F|celsius|fahrenheit)(?![a-z])", re.IGNORECASE
)
"""Temperature units, in which a blank does not mean a product."""
_NOT_AN_INDEX = re.compile(r"[^\W\d_]|[%‰°℃℉㍱-㏟-]")


def plain_label(label: str) -> tuple[str, str]:
    """A header without the brackets at its end, and the text in these brackets."""
    found = _BRACKETS.fullmatch(label)
    if found is None or not found[1]:
        return label, ""
    return found[1], found[2] or found[3] or ""


def column_and_unit(label: str) -> tuple[str, Unit | CapitalUnit | None]:
    """The column name and the unit in a header such as `F [N]` or `F (N)`.

    If the brackets contain no unit, they belong to the name: `x[1]`, `f(x)`, `v (filtered)`.
    """
    found = _COLUMN_AND_UNIT.fullmatch(label)
    text = "" if found is None else found[2] or found[3] or ""
    unit = written_unit(text) if _NOT_AN_INDEX.search(text) else None
    return (label, None) if found is None or unit is None else (found[1], unit)


def written_unit(text: str) -> Unit | CapitalUnit | None:
    """The unit of a text, including spellings of loggers; None if it is not a unit."""
    # the only powers that loggers write as letters; behind `⁻` the parser knows them
    text = _SUPERSCRIPT.sub(lambda found: f"^{_DIGITS[found.group()]}", text.strip())
    text = "1" if text == "-" else _DEGREES.sub(_degrees, text)
    if is_doubtful(text):
        return None
    # `J/(kg K)`; two words in brackets are most often no product
    if "/(" in text:
        text = _BETWEEN_FACTORS.sub("*", text)
    return capital_unit(text) if is_capital(text) else repaired(text)


def _degrees(found: re.Match[str]) -> str:
    scale = found[1][0].upper()
    return f"DEG{scale}" if is_capital(found.group()) else f"deg{scale}"


@dataclass(frozen=True, slots=True)
class UnknownUnit:
    """A unit text of a file that is not a known unit; `meant` is a similar known one."""

    text: str
    meant: str | None
    scale: float = 1.0
    """Factor that converts values to `meant`."""


@dataclass(frozen=True, slots=True)
class TwoUnits:
    """Conflicting units that a file states for one column: in its name, and separately."""

    named: Unit
    stated: Unit
    place: Span | None = None


@dataclass(frozen=True, slots=True)
class ShownUnit:
    """A display unit of a workbook's cells (or None), the first such cell, and their count."""

    unit: Unit | CapitalUnit | UnknownUnit | None
    cell: str
    count: int
    thousands: int = 0
    """The number of divisions by 1000 in the display."""


@dataclass(frozen=True, slots=True)
class MixedUnits:
    """Several display units within one column of a workbook."""

    shown: tuple[ShownUnit, ...]


StatedUnit: TypeAlias = Unit | CapitalUnit | UnknownUnit | TwoUnits | MixedUnits


def joint_unit(label: str, stated: StatedUnit | None) -> StatedUnit | None:
    """The unit of a column from its header and from a separate statement; they may conflict."""
    named = column_and_unit(label)[1]
    return (stated or unknown_unit(label)) if named is None else one_unit(named, stated)


def one_unit(first: StatedUnit | None, second: StatedUnit | None) -> StatedUnit | None:
    """Merges two statements of a unit in one file: equal units, a known one, or a conflict."""
    match first, second:
        case (None, found) | (found, None):
            return found
        case (TwoUnits() | MixedUnits() as both, _) | (_, TwoUnits() | MixedUnits() as both):
            return both
        case (UnknownUnit(), UnknownUnit()):
            return first
        case (UnknownUnit(), known) | (known, UnknownUnit()):
            return known
        case _:
            pass
    for unit in _readings(first):
        for other in _readings(second):
            if unit.same_as(other):
                # capitals have many readings: the other text decides
                return second if isinstance(first, CapitalUnit) else first
    return TwoUnits(_readings(first)[0], _readings(second)[0])


def unit_of_cells(shown: Sequence[ShownUnit], stated: StatedUnit | None) -> StatedUnit | None:
    """The unit of a workbook's cells from their display units and the column's stated unit.

    Cells displayed without a unit have the stated one.
    """
    known = stated if isinstance(stated, Unit | CapitalUnit) else None
    different: list[ShownUnit] = []
    for one in shown:
        unit = one.unit or known
        mine = replace(one, unit=_thousandth(unit, one.thousands))
        if not any(_is_same(mine.unit, other.unit) for other in different):
            different.append(mine)
        # a header of kN above `12.0 kN` is that of the numbers that are shown
        if one.thousands and isinstance(one.unit, Unit | CapitalUnit):
            agreed = one_unit(stated, one.unit)
            stated = stated if isinstance(agreed, TwoUnits) else mine.unit
    if len(different) > 1:
        return MixedUnits(tuple(different))
    return one_unit(stated, different[0].unit if different else None)


def _thousandth(
    unit: Unit | CapitalUnit | UnknownUnit | None, times: int
) -> Unit | CapitalUnit | UnknownUnit | None:
    """The unit of the stored values if `times` divisions by 1000 give `unit` on display.

    N for kN and g for kg; an UnknownUnit if no prefix fits.
    """
    if not times or unit is None or isinstance(unit, UnknownUnit):
        return unit
    if isinstance(unit, CapitalUnit):
        smaller = [_thousandth(reading, times) for reading in unit.readings]
        readings = tuple(one for one in smaller if isinstance(one, Unit))
        written = unit.written and _thousandth(unit.written, times)
        if readings:
            return replace(
                unit, readings=readings, written=written if isinstance(written, Unit) else None
            )
    found = unit.prefixed(-3 * times) if isinstance(unit, Unit) else None
    return found or UnknownUnit(f"{unit.text}/{1000**times}", None)


def _is_same(
    unit: Unit | CapitalUnit | UnknownUnit | None, other: Unit | CapitalUnit | UnknownUnit | None
) -> bool:
    if isinstance(unit, Unit) and isinstance(other, Unit):
        return unit.same_as(other)
    return unit == other


def _readings(unit: Unit | CapitalUnit) -> tuple[Unit, ...]:
    return (unit,) if isinstance(unit, Unit) else unit.readings


def with_case(
    unit: StatedUnit | None, labels: Sequence[str], texts: Sequence[str]
) -> StatedUnit | None:
    """The unit, with `is_as_written` set from the other units and headers of the file."""
    if not isinstance(unit, CapitalUnit):
        return unit
    return replace(unit, is_as_written=is_case_kept(unit, labels, texts))


def is_case_kept(unit: CapitalUnit, labels: Sequence[str], texts: Sequence[str]) -> bool:
    """True if capitals of a unit are intended in a file with these headers and other units."""
    plain = [plain_label(label) for label in labels]
    units = [text for text in (*texts, *(unit for _, unit in plain)) if text]
    return keeps_case(unit.text, units, (name for name, _ in plain))


def stated_unit(text: str) -> Unit | CapitalUnit | UnknownUnit | None:
    """The unit in a file's unit field, such as `km/h`, `m s-1` or `seconds since 1970-01-01`.

    None if the field is empty or a marker for a missing value.
    """
    text = text.strip()
    # of times that CF counts from a date; products stand side by side there and in UDUNITS
    plain = text.split(" since ")[0]
    plain = _WHOLE_TEXTS.get(plain, plain)
    if plain.lower() in MISSING | {"none"}:
        return None
    found = written_unit(plain) or written_unit(_BETWEEN_FACTORS.sub("*", plain))
    return found or _unknown(text, plain)


def unknown_unit(label: str) -> UnknownUnit | None:
    """The text in the brackets of a header if it should be a unit but is not one."""
    found = _COLUMN_AND_UNIT.fullmatch(label)
    text = "" if found is None else (found[2] or found[3] or "").strip()
    if not _NOT_AN_INDEX.search(text) or text.lower() in MISSING or written_unit(text) is not None:
        return None
    return _unknown(text, text)


def _unknown(text: str, plain: str) -> UnknownUnit:
    """An unknown unit and a similar known one: `rpm` with factor 1000 for `krpm`."""
    scale = 1.0
    plain = without_doubtful(plain)
    for _ in range(MOST_REPAIRS):
        try:
            return UnknownUnit(text, parse_unit(plain).text, scale)
        except UnitError as error:
            has_scale = error.scale != 1.0
            instead = error.repair if has_scale else error.replacement
            scale *= error.scale
            plain = plain[: error.start] + (instead or "") + plain[error.end :]
    return UnknownUnit(text, None)


def is_unit(cell: str) -> bool:
    """True if a cell is empty or a unit, with or without brackets."""
    text = without_brackets(cell)
    return not text or written_unit(text) is not None


def without_brackets(cell: str) -> str:
    """The text of a cell without enclosing brackets: `N` of `[N]`, but `J/(kg K)` unchanged."""
    text = cell.strip()
    found = _AROUND.fullmatch(text)
    return text if found is None else found[1] or found[2] or ""


def units_line(cells: Sequence[str]) -> tuple[str, ...] | None:
    """The texts of a line of units: every cell is a unit or empty, and none is a number.

    None for any other line. A line with only markers for missing values is a data row.
    """
    if any(map(is_number, cells)) or not all(map(is_unit, cells)):
        return None
    if all(cell.strip().lower() in MISSING for cell in cells):
        return None
    return tuple(map(without_brackets, cells))


def is_number(text: str) -> bool:
    """True if a cell is a number; NaN and infinities are numbers, `1_000` is not."""
    try:
        float(text)
    except ValueError:
        return False
    # float() takes the underscores of Python's literals
    return "_" not in text
