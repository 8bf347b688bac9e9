"""Reads the header of a text table: column names, their units, and the delimiter."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import TypeAlias

from msnn.data.formats.table import ColumnKey, WantedColumns
from msnn.data.formats.written_units import (
    ShownUnit,
    StatedUnit,
    TwoUnits,
    column_and_unit,
    is_number,
    joint_unit,
    plain_label,
    unit_of_cells,
    units_line,
    with_case,
    written_unit,
)
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.sections.data import THOUSANDS

BLANKS = " "
"""The delimiter of tables whose cells are separated by one or more blanks or tabs."""

# ";" before ",": with decimal commas both are there
_DELIMITERS = (";", ",", "\t", "|", BLANKS)
LONGEST_LINE = 1 << 22
"""Maximum characters per line: 200,000 numbers, more columns than a measurement has."""

Lines: TypeAlias = Callable[[], Iterator[tuple[int, str]]]
"""Returns an iterator over the lines from the first on, with line numbers from 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """The layout of a text file: `skip` lines, an optional header line, rows."""

    delimiter: str = ","
    is_usual: bool = False
    """True if the spec gives no delimiter, so that it may be inferred from the header."""
    decimal: str = "."
    thousands: str | None = None
    """The sign between groups of three digits, or None."""
    comment: str | None = None
    header: bool = True
    skip: int = 0
    is_text: bool = True
    """False for a workbook, whose numbers have no signs that `csv:` names."""

    def is_grouped(self, cell: str) -> bool:
        """True for a number with signs of thousands between groups of three digits."""
        if self.thousands is None:
            return False
        return _grouped(THOUSANDS[self.thousands], self.decimal).fullmatch(cell) is not None

    def plain(self, cell: str) -> str:
        """The text of a number as Python reads it: no signs of thousands, a decimal point."""
        if self.thousands is not None and self.is_grouped(cell):
            cell = cell.translate(dict.fromkeys(map(ord, THOUSANDS[self.thousands])))
        return cell if self.decimal == "." else cell.replace(self.decimal, ".")


@cache
def _grouped(signs: str, decimal: str) -> re.Pattern[str]:
    """`1.234.567,5`; the first group is not 0, as `0.123` is a number with decimals."""
    digits = rf"[+-]?[1-9]\d{{0,2}}(?:[{re.escape(signs)}]\d{{3}})+"
    return re.compile(rf"{digits}(?:{re.escape(decimal)}\d*)?(?:[eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """The first line with content; `lines` is 0 if it is data, 2 if a line of units follows."""

    file: str
    dialect: Dialect
    line: int
    text: str
    names: tuple[str, ...]
    lines: int
    below: int = 0
    """Line number of the units, if there is such a line."""
    below_units: tuple[str, ...] = ()
    """The texts in that line."""
    shown_units: Mapping[int, tuple[ShownUnit, ...]] = field(
        default_factory=dict[int, tuple[ShownUnit, ...]]
    )
    """Units in the number formats of a workbook's columns, by index."""

    @property
    def width(self) -> int:
        return len(self.names)

    @property
    def skipped(self) -> int:
        """The number of lines before the first data row, without blank lines directly before it."""
        return max(self.line, self.below) if self.lines else self.dialect.skip

    @property
    def place(self) -> Span:
        return Span(
            file=self.file,
            line=self.line,
            column=1,
            end_line=self.line,
            end_column=len(self.text) + 1,
        )

    @property
    def holds_numbers(self) -> bool:
        """True if all cells of the line are numbers, so that it is probably data."""
        # a header of numbers is one that is missing
        return all(is_number(self.dialect.plain(name)) for name in self.names)

    def label(self, index: int) -> str:
        """The name of a column in messages: from the header, else its index."""
        return self.names[index] if self.lines else str(index)

    def places(self, wanted: WantedColumns) -> dict[ColumnKey, int]:
        """The index of each requested column that exists. Raises SpecError with all missing
        columns.

        A key matches the header's name, or the name before its unit: `F` matches `F [N]`.
        """
        found: dict[ColumnKey, int] = {}
        faults: list[Diagnostic] = []
        missing: dict[str, str] = {}
        names = self.names if self.lines else ()
        plain = [column_and_unit(name)[0] for name in names]
        for key, user in wanted.users.items():
            if isinstance(key, int):
                if key < self.width:
                    found[key] = key
                elif key not in wanted.spare:
                    faults.append(
                        errors.no_such_index(key, self.file, self.width, user, self.place)
                    )
                continue
            # a name as it stands counts before one without its unit
            alike = [index for index, name in enumerate(names) if name == key]
            alike = alike or [index for index, name in enumerate(plain) if name == key]
            if len(alike) == 1:
                found[key] = alike[0]
            elif alike:
                named = errors.key_of_column(user, str(alike[0]))
                repair = f"choose one by its index: `{named}`; {alike[1]} is the next"
                faults.append(errors.duplicate_column(key, self.file, self.place, repair))
            elif key not in wanted.spare:
                missing[key] = user
        if missing:
            numbers = self.lines > 0 and self.holds_numbers
            faults.append(
                errors.missing_columns(
                    missing,
                    self.file,
                    names,
                    self.place,
                    numbers=numbers,
                    width=0 if self.lines else self.width,
                )
            )
        if faults:
            raise SpecError(faults)
        return found

    def units(self, places: Iterable[int]) -> dict[int, StatedUnit]:
        """The units that the file states for columns, by index."""
        found: dict[int, StatedUnit] = {}
        for index in places if self.lines else ():
            below = written_unit(self.below_units[index]) if self.below_units else None
            unit = joint_unit(self.names[index], below)
            unit = unit_of_cells(self.shown_units.get(index, ()), unit)
            unit = with_case(unit, self.names, self.below_units)
            if unit is not None:
                found[index] = (
                    replace(unit, place=self.place) if isinstance(unit, TwoUnits) else unit
                )
        return found


def read_header(lines: Lines, shown: str, dialect: Dialect, keys: Iterable[ColumnKey]) -> Header:
    """The header of a table. Raises SpecError if it is empty or if the delimiter is clearly wrong.

    If all keys are indices, a first line of numbers is data. If the spec gives no delimiter and the
    default one yields a single column, a delimiter that finds all names is used.
    """
    keys = set(keys)
    (line, text), below = _first_two(lines)
    if not line:
        raise SpecError((errors.empty_file(shown, header=False),))
    # only where no name is found: a header that has some is the right line with a wrong name
    if dialect.header and not _finds_any(text, keys):
        _refuse_late_header(lines, shown, dialect, keys)
    names = header_cells(text, dialect.delimiter)
    # a single column is no fault where nothing else is wanted
    if len(names) == 1 and not keys <= {names[0], plain_label(names[0])[0], 0}:
        meant = _meant_delimiter(text, keys)
        if meant is not None and not (dialect.is_usual and _finds_all(text, meant, keys)):
            place = Span(file=shown, line=line, column=1, end_line=line, end_column=len(text) + 1)
            raise SpecError((errors.wrong_delimiter(shown, dialect.delimiter, meant, place),))
        # one that finds every name cannot be a mistake; another one is only proposed
        dialect = replace(dialect, delimiter=meant or dialect.delimiter)
        names = header_cells(text, dialect.delimiter)
    by_index = all(isinstance(key, int) for key in keys)
    header = Header(file=shown, dialect=dialect, line=line, text=text, names=names, lines=0)
    if not dialect.header or (by_index and header.holds_numbers):
        return header
    # the line below may have units, as MATLAB and many loggers write them
    cells = split_cells(below[1], dialect.delimiter)
    units = units_line(cells) if len(cells) == len(names) else None
    if units is None:
        return replace(header, lines=1)
    return replace(header, lines=2, below=below[0], below_units=units)


def _first_two(lines: Lines) -> Sequence[tuple[int, str]]:
    found = list(islice(lines(), 2))
    return [*found, *((0, ""), (0, ""))][:2]


def _meant_delimiter(text: str, keys: Iterable[ColumnKey]) -> str | None:
    """A delimiter that splits the header into all names, else the one with most cells."""
    cells = {sign: len(header_cells(text, sign)) for sign in _DELIMITERS}
    # a sign that separates nothing is none
    several = [sign for sign in _DELIMITERS if cells[sign] > 1]
    fitting = [sign for sign in several if _finds_all(text, sign, keys)]
    return max(fitting or several, key=lambda sign: cells[sign], default=None)


def _finds_all(text: str, sign: str, keys: Iterable[ColumnKey]) -> bool:
    """True if a delimiter finds every name in the header, and at least one name is requested."""
    names = header_cells(text, sign)
    known = {*names, *(column_and_unit(name)[0] for name in names)}
    wanted = [key for key in keys if isinstance(key, str)]
    return bool(wanted) and known.issuperset(wanted)


def _finds_any(text: str, keys: Iterable[ColumnKey]) -> bool:
    return any(_finds_all(text, sign, [key]) for sign in _DELIMITERS for key in keys)


def _refuse_late_header(
    lines: Lines, shown: str, dialect: Dialect, keys: Iterable[ColumnKey]
) -> None:
    """Raises SpecError if a later line contains every name: many loggers write a preamble first."""
    signs = _DELIMITERS if dialect.is_usual else (dialect.delimiter,)
    # a bound: a file of data without names would be searched to its end
    for line, text in islice(lines(), 1, _FURTHEST_HEADER):
        if any(_finds_all(text, sign, keys) for sign in signs):
            end = len(text) + 1
            place = Span(file=shown, line=line, column=1, end_line=line, end_column=end)
            raise SpecError((errors.late_header(shown, line, place),))


_FURTHEST_HEADER = 100


def content_lines(
    path: Path, dialect: Dialect, shown: str, *, blank: bool = False
) -> Iterator[tuple[int, str]]:
    """Number (from 1) and text of the lines after `skip` that are neither comments nor blank.

    With `blank`, blank lines are included as empty texts. Raises SpecError for a line over
    LONGEST_LINE.
    """
    # a byte order mark is no part of the first name; `csv` wants line ends as they are
    with path.open(encoding="utf-8-sig", newline="") as file:
        for number, line in enumerate(file, start=1):
            if number <= dialect.skip:
                continue
            if len(line) > LONGEST_LINE:
                reason = f"its line {number} has {len(line)} characters, which is no row"
                here = Span(file=shown, line=number, column=1, end_line=number, end_column=1)
                repair = "write a line for each row"
                raise SpecError((errors.unreadable_file(shown, reason, repair, here),))
            plain = line.lstrip()
            if not plain:
                if blank:
                    yield number, ""
            elif dialect.comment is None or not plain.startswith(dialect.comment):
                yield number, line.rstrip("\r\n")


def with_blank_rows(lines: Lines, header: Header) -> Lines:
    """The lines of a one-column table; blank lines between rows are missing values.

    Blank lines at the end of the file are ignored.
    """

    def kept() -> Iterator[tuple[int, str]]:
        blank: list[tuple[int, str]] = []
        for number, text in lines():
            if text:
                yield from blank
                blank.clear()
                yield number, text
            elif number > header.skipped:
                blank.append((number, text))

    return kept


def split_cells(line: str, delimiter: str) -> list[str]:
    """The cells of one line, with quotes removed."""
    if '"' in line:
        # its own limit is shorter than ours
        csv.field_size_limit(LONGEST_LINE)
    if delimiter == BLANKS:
        if '"' not in line:
            return line.split() or [""]
        return next(csv.reader([line.strip()], delimiter=" ", skipinitialspace=True))
    if '"' not in line:
        return line.split(delimiter)
    return next(csv.reader([line], delimiter=delimiter))


def header_cells(text: str, delimiter: str) -> tuple[str, ...]:
    """The names in a header; with blanks as delimiter, `F [N]` and `T [deg C]` are one name
    each.
    """
    found: list[str] = []
    for cell in split_cells(text, delimiter):
        # `[N]` alone is the unit of the column before, and brackets hold together what is in them
        is_inside = bool(found) and (cell[:1] in "[(" or _is_open(found[-1]))
        if delimiter == BLANKS and is_inside:
            found[-1] += f" {cell}"
        else:
            found.append(cell.strip())
    return tuple(found)


def _is_open(text: str) -> bool:
    return any(text.count(left) > text.count(right) for left, right in ("[]", "()"))
