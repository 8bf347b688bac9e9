"""Opens Excel workbooks, and finds dates and units in the number formats of cells: `0.0 "km/h"`."""

from __future__ import annotations

import operator
import re
import warnings
import zipfile
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from html import unescape
from importlib import import_module
from pathlib import Path
from typing import Any

from msnn.data.formats.written_units import CapitalUnit, ShownUnit, UnknownUnit, stated_unit
from spec_schema.units.unit import ONE, Unit

_LITERAL = re.compile(r'"[^"]*"|[\\_*].|\[(?!(?:h+|m+|s+)\])[^\]]*\]', re.IGNORECASE | re.DOTALL)
"""Literals in a number format: quoted text, fills, colours, conditions; `[h]` is a duration."""
_PARTS_OF_SECONDS = re.compile(r"(s\]?)[.,]?0+", re.IGNORECASE)
_NUMBER = re.compile(r"[0#?]|General|Standard", re.IGNORECASE)
_DATE = re.compile(r"[dmhys]", re.IGNORECASE)


def is_date_format(code: str) -> bool:
    """True if a number format shows its cells as dates, times or durations.

    Digits other than fractions of a second make it a number format: in `0.0 km/h`, m and h are a
    unit.
    """
    plain = _LITERAL.sub("", code).partition(";")[0]
    plain = _PARTS_OF_SECONDS.sub(r"\1", plain)
    return _NUMBER.search(plain) is None and _DATE.search(plain) is not None


@contextmanager
def first_sheet(path: Path, *, data_only: bool = True) -> Generator[Any]:
    """The first sheet of a workbook, with cells as dates if `is_date_format` is true.

    `data_only` yields the saved values of formulas, otherwise their texts.
    """
    # an optional package without types
    openpyxl: Any = import_module("openpyxl")
    formats: Any = import_module("openpyxl.styles.numbers")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # styles that it does not know
        book: Any = openpyxl.load_workbook(path, read_only=True, data_only=data_only)
        try:
            own: list[str] = list(book._number_formats)
            first_own: int = formats.BUILTIN_FORMATS_MAX_SIZE
            codes = (
                formats.BUILTIN_FORMATS.get(style.numFmtId, "")
                if style.numFmtId < first_own
                else own[style.numFmtId - first_own]
                for style in book._cell_styles
            )
            # by its own rule any `m` or `h` that is not quoted makes a date
            book._date_formats = {index for index, code in enumerate(codes) if is_date_format(code)}
            sheet: Any = book.worksheets[0]
            sheet.reset_dimensions()  # a size that the file states may be smaller than the sheet
            yield sheet
        finally:
            book.close()


_STYLES = "xl/styles.xml"
_MOST = 1 << 20
_PERCENTS = re.compile(rb'numFmtId="(?:9|10)"')
"""Matches the built-in percent formats in a workbook's styles."""
_CODES = re.compile(r"""formatCode=(?:"([^"]*)"|'([^']*)')""")
_TOKEN = re.compile(
    r'"(?P<quoted>[^"]*)"|\\(?P<escaped>.)|[_*].|\[\$(?P<currency>[^\]-]*)[^\]]*\]'
    r"|\[(?P<condition>[<>=]+\s*-?[\d.]+(?:[Ee][+-]?\d+)?)\]|\[[^\]]*\]"
    r"|(?P<digit>General|Standard|[0#?](?:[Ee][+-](?=[0#?]))?)|(?P<mark>[.,%@])|(?P<end>;)|(?P<letter>.)",
    re.DOTALL,
)
_THOUSANDS = re.compile(r"(?<=0),+(?![0,])")
"""Commas after the last digit: each divides the displayed number by 1000."""
_CONDITION = re.compile(r"([<>=]+)\s*(.+)")
_COMPARED: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "=": operator.eq,
    "<>": operator.ne,
}


@dataclass(frozen=True, slots=True)
class _Section:
    """One of the sections of a number format, which are separated by `;`."""

    unit: Unit | CapitalUnit | UnknownUnit | None
    thousands: int = 0
    """The number of divisions by 1000 for display."""
    condition: tuple[str, float] | None = None
    """Condition on the displayed numbers, if the format has one: `[>=1000]`."""
    has_digits: bool = True


def units_of_formats(
    path: Path, columns: Collection[int], after: int
) -> Mapping[int, tuple[ShownUnit, ...]]:
    """The units with which columns are displayed below row `after`, by column index.

    A percent cell stores the ratio: 0.5 for a displayed 50 %. A comma after the digits displays a
    thousandth of the value.
    """
    if not _may_show_units(path):
        return {}
    found: dict[int, dict[tuple[str, int], ShownUnit]] = {index: {} for index in columns}
    with first_sheet(path) as sheet:
        for row in sheet.iter_rows(min_row=after + 1):
            for index in columns:
                cell = row[index] if index < len(row) else None
                if cell is None or cell.data_type != "n" or cell.value is None:
                    continue
                section = _section(_sections(str(cell.number_format)), float(cell.value))
                if not section.has_digits:  # a dash for 0 says nothing of units
                    continue
                # formats of one unit differ in their digits
                key = "" if section.unit is None else section.unit.text, section.thousands
                one = found[index].get(key)
                if one is None:
                    one = ShownUnit(section.unit, str(cell.coordinate), 0, section.thousands)
                found[index][key] = replace(one, count=one.count + 1)
    return {index: tuple(shown.values()) for index, shown in found.items()}


def _may_show_units(path: Path) -> bool:
    # most workbooks show none, and opening one takes time
    try:
        with zipfile.ZipFile(path) as book, book.open(_STYLES) as styles:
            text = styles.read(_MOST)
    except (OSError, KeyError, zipfile.BadZipFile):
        return False
    codes = (a or b for a, b in _CODES.findall(text.decode("utf-8", "replace")))
    sections = (section for code in codes for section in _sections(unescape(code)))
    shows = any(section.unit is not None or section.thousands for section in sections)
    return shows or _PERCENTS.search(text) is not None


def _section(sections: Sequence[_Section], value: float) -> _Section:
    """The section that displays a number: the first whose condition is true, else the last."""
    *first, last = sections[:3]  # the fourth shows texts
    # positive numbers and 0, negative ones; with three sections the last one shows 0
    usual = ((">" if len(first) == 2 else ">=", 0.0), ("<", 0.0))
    for section, condition in zip(first, usual, strict=False):
        sign, limit = section.condition or condition
        if _COMPARED[sign](value, limit):
            return section
    return last


@lru_cache(256)
def _sections(format: str) -> tuple[_Section, ...]:
    """The sections of a number format. A section without a unit uses that of the others."""
    parts: list[list[re.Match[str]]] = [[]]
    for token in _TOKEN.finditer(format):
        if token["end"]:
            parts.append([])
        else:
            parts[-1].append(token)
    sections = [_read(part) for part in parts]
    unit = next((section.unit for section in sections if section.unit is not None), None)
    return tuple(
        section if section.unit is not None else replace(section, unit=unit) for section in sections
    )


def _read(tokens: Sequence[re.Match[str]]) -> _Section:
    digits = [index for index, token in enumerate(tokens) if token["digit"]]
    if not digits:
        return _Section(None, condition=_condition(tokens), has_digits=False)
    marks = "".join("0" if token["digit"] else token["mark"] or "" for token in tokens)
    if "%" in marks:
        unit = ONE
    else:
        before, between, after = (
            _text(part)
            for part in (
                tokens[: digits[0]],
                tokens[digits[0] : digits[-1]],
                tokens[digits[-1] :],
            )
        )
        # the unit stands behind the number, seldom before it: `"v = "0.0 "km/h"`
        shown = before + between + after if _has_letters(between) else after or before
        unit = stated_unit(shown) if shown else None
    thousands = sum(map(len, _THOUSANDS.findall(marks)))
    return _Section(unit, thousands, _condition(tokens))


def _condition(tokens: Sequence[re.Match[str]]) -> tuple[str, float] | None:
    for token in tokens:
        if token["condition"] and (found := _CONDITION.fullmatch(token["condition"])):
            return (found[1], float(found[2])) if found[1] in _COMPARED else None
    return None


def _text(tokens: Sequence[re.Match[str]]) -> str:
    """The text around a number, without signs; empty if it contains no letters."""
    text = "".join(
        token["quoted"] or token["escaped"] or token["currency"] or token["letter"] or ""
        for token in tokens
    ).strip(" \xa0\u202f-+:")
    if text.count("(") != text.count(")"):  # negative numbers in parentheses
        text = text.strip("() ")
    return text if _has_letters(text) else ""


def _has_letters(text: str) -> bool:
    return any(letter.isalpha() or letter in "%°€$‰" for letter in text)
