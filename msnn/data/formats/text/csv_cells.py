"""Reads a CSV file cell by cell, to report exactly which cells are wrong and where.

`csv_file` reads files without such cells by numpy.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.data.formats.table import ColumnKey, WantedColumns
from msnn.data.formats.text.csv_header import Dialect, Header, Lines, split_cells
from msnn.data.formats.written_units import MISSING, is_number
from msnn.errors.data import cells as cell_errors
from msnn.errors.data import cells as data_units
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.moments import Moment, read_moment
from spec_schema.expressions.time_format import TimeFormat, written_format
from spec_schema.sections.data import THOUSANDS

CellFault = Callable[[str, int, str, str, int, Span], Diagnostic]
"""A constructor in `errors`: (file, row, column, text, count of further faults, place)."""

# `1,5` where the delimiter is no comma
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_POINTS = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+")
"""`1.500`: 1500 if the decimal sign is a comma, otherwise 1.5."""
_LONGEST_SHOWN = 40
_MISSING_TIME: CellFault = partial(cell_errors.missing_value, is_time=True)


@dataclass(frozen=True, slots=True)
class CheckedColumns:
    """Columns of a table, and the first date of date columns."""

    columns: Sequence[FloatArray]
    begins: Mapping[ColumnKey, Moment]


def checked_columns(
    lines: Lines, header: Header, places: Mapping[ColumnKey, int], wanted: WantedColumns
) -> CheckedColumns:
    """The columns at `places`; NaN for empty cells of optional columns.

    Raises SpecError with one diagnostic per kind of fault and column, which shows the first fault
    and counts the others.
    """
    faults = _Faults()
    readers = [_reader(key, index, header.dialect, wanted) for key, index in places.items()]
    line: _Line | None = None
    for line in _lines(lines, header):
        # an odd number: cells are split at delimiters inside quotes then, and their count says
        # nothing
        if line.text.count('"') % 2:
            faults.add("quote", line.quote_fault)
        elif len(line.cells) != header.width:
            faults.add("ragged", line.ragged_fault)
        else:
            for reader in readers:
                # taken though faulty, so that rows keep their numbers
                fault = reader.fault_of(line.cells[reader.index].strip())
                if fault is not None:
                    faults.add((fault, reader.index), line.cell_fault(fault, reader.index))
    if line is None:
        raise SpecError((errors.empty_file(header.file, header=header.lines > 0),))
    # all of the file first: who mends a log wants to know of every kind of fault at once
    faults.raise_found()
    begins = {
        key: Moment(reader.nanoseconds[0], reader.has_zone)
        for key, reader in zip(places, readers, strict=True)
        # a column of time that has numbers begins nowhere
        if isinstance(reader, _Times) and reader.nanoseconds
    }
    return CheckedColumns([reader.column for reader in readers], begins)


def _reader(key: ColumnKey, index: int, dialect: Dialect, wanted: WantedColumns) -> _Numbers:
    if key in wanted.moments and wanted.time_format is not None:
        return _FormattedTimes(
            index=index, dialect=dialect, may_miss=False, format=written_format(wanted.time_format)
        )
    return (_Times if key in wanted.moments else _Numbers)(
        index=index,
        dialect=dialect,
        may_miss=key in wanted.optional,
        marks=wanted.missing.get(key, frozenset()),
    )


def line_of_row(lines: Lines, header: Header, row: int) -> int:
    """The line number in the file, from 1, of a data row."""
    # read again: places are asked for once or twice in a file of millions of lines
    for found, (number, _) in enumerate(lines()):
        if found == row + header.lines:
            return number
    raise IndexError("the file has fewer rows")


def cell_of_row(lines: Lines, header: Header, row: int, index: int) -> tuple[str, Span]:
    """The text and place of a cell in a data row."""
    return next(line for line in _lines(lines, header) if line.row == row).cell(index)


@dataclass(slots=True, kw_only=True)
class _Numbers:
    """Reads a column of numbers."""

    index: int
    dialect: Dialect
    may_miss: bool
    marks: frozenset[str] = frozenset()
    """Lower-case texts that mean a missing value."""
    values: list[float] = field(default_factory=list[float])

    def fault_of(self, cell: str) -> CellFault | None:
        """Appends the value of a cell, and returns the constructor of its diagnostic or None."""
        value, fault = _number(cell, self.dialect, self.may_miss, self.marks)
        self.values.append(value)
        return fault

    @property
    def column(self) -> FloatArray:
        return np.array(self.values)


@dataclass(slots=True, kw_only=True)
class _Times(_Numbers):
    """Reads a time column: dates if the first cell is a date, else numbers."""

    nanoseconds: list[int] = field(default_factory=list[int])
    has_zone: bool = False

    def fault_of(self, cell: str) -> CellFault | None:
        # the first cell decides what the column is; a date further down in numbers is a fault of
        # that cell
        moment = None if self.values else read_moment(cell)
        if moment is None:
            if self.nanoseconds:
                is_missing = cell.lower() in MISSING
                return _MISSING_TIME if is_missing else data_units.not_a_moment
            fault = _Numbers.fault_of(self, cell)
            return _MISSING_TIME if fault == cell_errors.missing_value else fault
        if not self.nanoseconds:
            self.has_zone = moment.has_zone
        self.nanoseconds.append(moment.nanoseconds)
        return data_units.mixed_zones if moment.has_zone != self.has_zone else None

    @property
    def column(self) -> FloatArray:
        """Seconds since the first row; exact to a nanosecond over a hundred days."""
        if not self.nanoseconds:
            return np.array(self.values)
        moments = np.array(self.nanoseconds, dtype=np.int64)
        # subtracted as integers: nanoseconds since 1970 have 61 bits, doubles 53
        return (moments - moments[0]) / 1e9


@dataclass(slots=True, kw_only=True)
class _FormattedTimes(_Times):
    """Reads a time column of dates in a format of the spec."""

    format: TimeFormat

    def fault_of(self, cell: str) -> CellFault | None:
        moment = self.format.moment(cell)
        if moment is None:
            if cell.lower() in MISSING:
                return _MISSING_TIME
            return _format_fault(self.format.text)
        self.nanoseconds.append(moment.nanoseconds)
        self.has_zone = moment.has_zone
        return None


@cache
def _format_fault(text: str) -> CellFault:
    return partial(data_units.unlike_format, wanted=text)


@cache
def _not_a_number(dialect: Dialect) -> CellFault:
    delimiter = dialect.delimiter if dialect.is_text else None
    return partial(cell_errors.not_a_number, delimiter=delimiter, decimal=dialect.decimal)


@cache
def _comma_fault(dialect: Dialect) -> CellFault:
    delimiter = dialect.delimiter if dialect.is_text else None
    return partial(cell_errors.decimal_comma, delimiter=delimiter)


@cache
def _group_fault(dialect: Dialect) -> CellFault:
    signs = {"thousands": dialect.thousands or "", "decimal": dialect.decimal}
    return partial(cell_errors.wrong_groups, **signs)


def _number(
    cell: str, dialect: Dialect, may_miss: bool, marks: frozenset[str] = frozenset()
) -> tuple[float, CellFault | None]:
    text = dialect.plain(cell)
    if text.lower() in MISSING or cell.lower() in marks:
        return math.nan, None if may_miss else cell_errors.missing_value
    # reading it as 1.5 would be wrong by a factor of a thousand without a word
    if dialect.decimal != "." and dialect.thousands != "." and _POINTS.fullmatch(cell):
        return math.nan, _not_a_number(dialect)
    if dialect.thousands is not None and (fault := _fault_of_groups(cell, dialect)) is not None:
        return math.nan, fault
    if not is_number(text):
        comma = _DECIMAL_COMMA.fullmatch(text) is not None
        return math.nan, (_comma_fault if comma else _not_a_number)(dialect)
    value = float(text)
    if math.isnan(value):  # "-nan", "+NaN"
        return value, None if may_miss else cell_errors.missing_value
    return value, cell_errors.infinite_value if math.isinf(value) else None


def _fault_of_groups(cell: str, dialect: Dialect) -> CellFault | None:
    """The fault of a cell with signs of thousands whose groups have not three digits."""
    signs = THOUSANDS[dialect.thousands or "."]
    if dialect.is_grouped(cell) or not any(sign in cell for sign in signs):
        return None
    digits = cell.translate(dict.fromkeys(map(ord, signs)))
    if is_number(digits.replace(dialect.decimal, ".")):
        return _group_fault(dialect)
    return _not_a_number(dialect)


def _lines(lines: Lines, header: Header) -> Iterator[_Line]:
    for found, (number, text) in enumerate(lines()):
        if found >= header.lines:
            cells = split_cells(text, header.dialect.delimiter)
            yield _Line(
                header=header, row=found - header.lines, number=number, text=text, cells=cells
            )


@dataclass(slots=True, kw_only=True)
class _Line:
    """One row of the file, and constructors of diagnostics about it."""

    header: Header
    row: int
    number: int
    text: str
    cells: list[str]

    def _place(self, start: int, end: int) -> Span:
        return Span(
            file=self.header.file,
            line=self.number,
            column=start + 1,
            end_line=self.number,
            end_column=end + 1,
        )

    def quote_fault(self, more: int) -> Diagnostic:
        column = self.text.rindex('"')
        place = self._place(column, column + 1)
        return cell_errors.unbalanced_quote(self.header.file, self.row, more, place)

    def ragged_fault(self, more: int) -> Diagnostic:
        found, expected = len(self.cells), self.header.width
        commas = self.header.dialect.delimiter == "," and found >= 2 * expected
        place = self._place(0, len(self.text))
        return cell_errors.ragged_row(
            self.header.file,
            self.row,
            found,
            expected,
            more,
            place,
            commas=commas,
            ends_empty=found == expected + 1 and not self.cells[-1].strip(),
        )

    def cell(self, index: int) -> tuple[str, Span]:
        """The text and place of a cell."""
        # cells lost their quotes when they were split: with quotes the whole line is underlined
        start = sum(len(cell) + 1 for cell in self.cells[:index])
        end = start + max(len(self.cells[index]), 1)
        if '"' in self.text:
            start, end = 0, len(self.text)
        return self.cells[index].strip()[:_LONGEST_SHOWN], self._place(start, end)

    def cell_fault(self, fault: CellFault, index: int) -> Callable[[int], Diagnostic]:
        label = self.header.label(index)
        text, place = self.cell(index)
        return lambda more: fault(self.header.file, self.row, label, text, more, place)


class _Faults:
    """The first fault of each kind, and the number of further ones."""

    def __init__(self) -> None:
        self._first: dict[object, Callable[[int], Diagnostic]] = {}
        self._count: dict[object, int] = {}

    def add(self, kind: object, make: Callable[[int], Diagnostic]) -> None:
        # made at the end, when it is known how many more there are
        self._first.setdefault(kind, make)
        self._count[kind] = self._count.get(kind, 0) + 1

    def count(self, kind: object) -> int:
        return self._count.get(kind, 0)

    def raise_found(self) -> None:
        if self._first:
            raise SpecError([make(self._count[kind] - 1) for kind, make in self._first.items()])
