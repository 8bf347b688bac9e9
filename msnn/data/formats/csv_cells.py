"""Reads a CSV file cell by cell, to say exactly which cells are wrong and where."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.data.formats.csv_header import Dialect, Header, content_lines, is_number, split_cells
from msnn.data.formats.table import ColumnKey
from msnn.errors import data_cells as cell_errors
from msnn.errors import data_files as errors
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import UnitError

CellFault = Callable[[str, int, str, str, int, Span], Diagnostic]
"""A constructor of `errors`: (file, row, column, text, more of the kind, place)."""

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_LONGEST_SHOWN = 40


def checked_columns(
    path: Path,
    header: Header,
    places: Mapping[ColumnKey, int],
    optional: frozenset[ColumnKey],
) -> list[FloatArray]:
    """The columns at `places`, NaN where an optional cell is empty.

    Raises SpecError with one diagnostic for each kind of fault and column; it shows the first and
    counts the others.
    """
    faults = _Faults()
    columns: list[list[float]] = [[] for _ in places]
    readers = [
        (column, index, key in optional)
        for column, (key, index) in zip(columns, places.items(), strict=True)
    ]
    line: _Line | None = None
    for line in _lines(path, header):
        if line.row == 0 and line.has_units:
            raise SpecError((line.units_fault(places),))
        if line.text.count('"') % 2:
            faults.add("quote", line.quote_fault)
        elif len(line.cells) != header.width:
            faults.add("ragged", line.ragged_fault)
        else:
            for column, index, may_miss in readers:
                value, fault = _number(line.cells[index].strip(), header.dialect, may_miss)
                column.append(value)
                if fault is not None:
                    faults.add((fault, index), line.cell_fault(fault, index))
    if line is None:
        raise SpecError((errors.empty_file(header.file, header=header.lines > 0),))
    faults.raise_found()
    return [np.array(column) for column in columns]


def line_of_row(path: Path, header: Header, row: int) -> int:
    """The line of the file, counted from 1, that holds a data row."""
    for found, (number, _) in enumerate(content_lines(path, header.dialect)):
        if found == row + header.lines:
            return number
    raise IndexError("the file has fewer rows")


@cache
def _comma_fault(delimiter: str) -> CellFault:
    return partial(cell_errors.decimal_comma, delimiter=delimiter)


def _number(cell: str, dialect: Dialect, may_miss: bool) -> tuple[float, CellFault | None]:
    text = cell if dialect.decimal == "." else cell.replace(dialect.decimal, ".")
    if not text or text.lower() in ("nan", "na", "null"):
        return math.nan, None if may_miss else cell_errors.missing_value
    if not is_number(text):
        comma = _DECIMAL_COMMA.fullmatch(text) is not None
        return math.nan, _comma_fault(dialect.delimiter) if comma else cell_errors.not_a_number
    value = float(text)
    if math.isnan(value):  # "-nan", "+NaN"
        return value, None if may_miss else cell_errors.missing_value
    return value, cell_errors.infinite_value if math.isinf(value) else None


def _lines(path: Path, header: Header) -> Iterator[_Line]:
    for found, (number, text) in enumerate(content_lines(path, header.dialect)):
        if found >= header.lines:
            cells = split_cells(text, header.dialect.delimiter)
            yield _Line(
                header=header, row=found - header.lines, number=number, text=text, cells=cells
            )


@dataclass(slots=True, kw_only=True)
class _Line:
    """One row of the file, and the faults that may be found in it."""

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

    @property
    def has_units(self) -> bool:
        """Whether no cell is a number and every one is empty or a unit."""
        cells = [cell.strip() for cell in self.cells]
        return any(cells) and not any(map(is_number, cells)) and all(map(is_unit, cells))

    def units_fault(self, places: Mapping[ColumnKey, int]) -> Diagnostic:
        units = {key: self.cells[index].strip() for key, index in places.items()}
        name, unit = next(((k, u) for k, u in units.items() if u), ("NAME", "UNIT"))
        columns = f"{{{name}: {{column: {name}, unit: {unit}}}}}"
        return cell_errors.line_of_units(self.header.file, columns, self._place(0, len(self.text)))

    def quote_fault(self, more: int) -> Diagnostic:
        column = self.text.rindex('"')
        place = self._place(column, column + 1)
        return cell_errors.unbalanced_quote(self.header.file, self.row, more, place)

    def ragged_fault(self, more: int) -> Diagnostic:
        found, expected = len(self.cells), self.header.width
        commas = self.header.dialect.delimiter == "," and found >= 2 * expected
        place = self._place(0, len(self.text))
        return cell_errors.ragged_row(
            self.header.file, self.row, found, expected, more, place, commas=commas
        )

    def cell_fault(self, fault: CellFault, index: int) -> Callable[[int], Diagnostic]:
        start = sum(len(cell) + 1 for cell in self.cells[:index])
        end = start + max(len(self.cells[index]), 1)
        if '"' in self.text:
            start, end = 0, len(self.text)
        label, text = self.header.label(index), self.cells[index].strip()[:_LONGEST_SHOWN]
        place = self._place(start, end)
        return lambda more: fault(self.header.file, self.row, label, text, more, place)


def is_unit(cell: str) -> bool:
    """Whether a cell is empty or a unit, with or without brackets around it."""
    try:
        parse_unit(cell.strip("[]()") or "1")
    except UnitError:
        return cell == "-"
    return True


class _Faults:
    """The first fault of each kind, and how many more there are."""

    def __init__(self) -> None:
        self._first: dict[object, Callable[[int], Diagnostic]] = {}
        self._count: dict[object, int] = {}

    def add(self, kind: object, make: Callable[[int], Diagnostic]) -> None:
        self._first.setdefault(kind, make)
        self._count[kind] = self._count.get(kind, 0) + 1

    def raise_found(self) -> None:
        if self._first:
            raise SpecError([make(self._count[kind] - 1) for kind, make in self._first.items()])
