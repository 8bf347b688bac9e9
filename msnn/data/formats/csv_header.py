"""Reads the header of a CSV file: names of columns, and the delimiter that would fit."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from msnn.data.formats.table import ColumnKey, WantedColumns
from msnn.errors import data_files as errors
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.source import Span

_DELIMITERS = (";", ",", "\t", "|")


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """How the text of a file is laid out: `skip` lines, a header line if there is one, rows."""

    delimiter: str = ","
    decimal: str = "."
    comment: str | None = None
    header: bool = True
    skip: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """The first line with content; `lines` is 0 where it is data already."""

    file: str
    dialect: Dialect
    line: int
    text: str
    names: tuple[str, ...]
    lines: int

    @property
    def width(self) -> int:
        return len(self.names)

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
        """Whether the line is one of data, by its looks."""
        return all(is_number(name.replace(self.dialect.decimal, ".")) for name in self.names)

    def label(self, index: int) -> str:
        """What messages call a column: its name, or its index."""
        return self.names[index] if self.lines else str(index)

    def places(self, wanted: WantedColumns) -> dict[ColumnKey, int]:
        """The index of each wanted column that is there; SpecError with all that are missing."""
        found: dict[ColumnKey, int] = {}
        faults: list[Diagnostic] = []
        missing: dict[str, str] = {}
        names = self.names if self.lines else ()
        for key, user in wanted.users.items():
            match key:
                case int() if key < self.width:
                    found[key] = key
                case _ if key in wanted.spare and key not in names:
                    pass
                case int():
                    faults.append(
                        errors.no_such_index(key, self.file, self.width, user, self.place)
                    )
                case str() if key not in names:
                    missing[key] = user
                case str() if names.count(key) > 1:
                    faults.append(errors.duplicate_column(key, self.file, self.place))
                case str():
                    found[key] = names.index(key)
        if missing:
            numbers = self.lines > 0 and self.holds_numbers
            faults.append(
                errors.missing_columns(missing, self.file, names, self.place, numbers=numbers)
            )
        if faults:
            raise SpecError(faults)
        return found


def read_header(path: Path, shown: str, dialect: Dialect, keys: Iterable[ColumnKey]) -> Header:
    """The header of a file; SpecError if the file is empty or the delimiter is plainly another.

    Where all keys are indices a first line of numbers is taken as data.
    """
    keys = set(keys)
    line, text = next(content_lines(path, dialect), (0, ""))
    if not line:
        raise SpecError((errors.empty_file(shown, header=False),))
    names = tuple(cell.strip() for cell in split_cells(text, dialect.delimiter))
    by_index = all(isinstance(key, int) for key in keys)
    header = Header(file=shown, dialect=dialect, line=line, text=text, names=names, lines=0)
    if dialect.header and not (by_index and header.holds_numbers):
        header = replace(header, lines=1)
    if len(names) == 1 and not keys <= {names[0], 0}:
        cells = {sign: len(split_cells(text, sign)) for sign in _DELIMITERS}
        best = max(cells, key=lambda sign: cells[sign])
        if cells[best] > 1:
            raise SpecError((errors.wrong_delimiter(shown, dialect.delimiter, best, header.place),))
    return header


def content_lines(path: Path, dialect: Dialect) -> Iterator[tuple[int, str]]:
    """Number (from 1) and text of the lines after `skip` that are not blank and no comment."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        for number, line in enumerate(file, start=1):
            if number <= dialect.skip or not line.strip():
                continue
            if dialect.comment is None or not line.lstrip().startswith(dialect.comment):
                yield number, line.rstrip("\r\n")


def split_cells(line: str, delimiter: str) -> list[str]:
    """The cells of one line, quotes removed."""
    if '"' not in line:
        return line.split(delimiter)
    return next(csv.reader([line], delimiter=delimiter))


def is_number(text: str) -> bool:
    """Whether a cell holds a number; NaN and infinities count, `1_000` does not."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text
