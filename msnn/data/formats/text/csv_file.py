"""Reads numeric columns from a CSV file: fast if it is valid, else with exact error reports."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from os import SEEK_END
from pathlib import Path

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.data.formats.table import ColumnKey, ColumnTable, WantedColumns
from msnn.data.formats.text.csv_cells import (
    CheckedColumns,
    cell_of_row,
    checked_columns,
    line_of_row,
)
from msnn.data.formats.text.csv_header import (
    BLANKS,
    Dialect,
    Header,
    Lines,
    content_lines,
    read_header,
    with_blank_rows,
)
from msnn.data.formats.text.text_encoding import not_utf8, refuse_other_formats
from msnn.errors.data import files as errors
from msnn.errors.data.rows import decimal_between_cells
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.errors.schema import ambiguous_thousands
from spec_schema.sections.data import THOUSANDS

_CHUNK = 1 << 20


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> ColumnTable:
    """The requested columns of a UTF-8 text file.

    An empty or NaN cell becomes NaN in optional columns and is an error in the others. `shown` is
    the file's name in messages. Raises SpecError with all errors of the file.
    """
    # `log.csv` that is an Excel file: its bytes would be told of as text that is not UTF-8
    refuse_other_formats(path, shown)
    try:
        return _table(path, shown, wanted, dialect)
    except UnicodeDecodeError as error:
        raise SpecError((not_utf8(path, shown, error),)) from error
    except OSError as error:
        raise SpecError((errors.unreadable_file(shown, error.strerror or str(error)),)) from error


def _table(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> ColumnTable:
    lines: Lines = partial(content_lines, path, dialect, shown)
    header = read_header(lines, shown, dialect, wanted.users)
    signs = header.dialect
    # in quotes it can be both: `"1,5","2,5"`
    is_both = signs.delimiter == signs.decimal and header.width > 1
    if is_both and not any('"' in text for _, text in lines()):
        raise SpecError((decimal_between_cells(shown, signs.decimal, header.place),))
    if signs.thousands is not None and signs.delimiter in THOUSANDS[signs.thousands]:
        repair = "name the true delimiter by `delimiter:`, or remove `thousands:`"
        role = f"separates the cells of {shown}"
        raise SpecError((ambiguous_thousands(signs.thousands, role, header.place, repair),))
    places = header.places(wanted)
    if header.width == 1:
        lines = with_blank_rows(partial(content_lines, path, dialect, shown, blank=True), header)
    # numpy first, as it is far faster; it explains nothing, so what it refuses is read cell by
    # cell
    # digits alone may be a date too: `20261122170000`
    is_plain = wanted.time_format is None
    columns = _numbers(path, header, tuple(places.values())) if is_plain else None
    if columns is None or not _complete(columns, tuple(places), wanted.optional):
        return text_table(lines, header, places, wanted)
    return named_table(lines, header, places, CheckedColumns(columns, {}))


def text_table(
    lines: Lines, header: Header, places: Mapping[ColumnKey, int], wanted: WantedColumns
) -> ColumnTable:
    """The requested columns of a table, read cell by cell. Raises SpecError with all errors."""
    return named_table(lines, header, places, checked_columns(lines, header, places, wanted))


def named_table(
    lines: Lines, header: Header, places: Mapping[ColumnKey, int], found: CheckedColumns
) -> ColumnTable:
    """The table with its stated units, and functions that locate its rows and cells."""

    def place(row: int) -> Span:
        line = line_of_row(lines, header, row)
        return Span(file=header.file, line=line, column=1, end_line=line, end_column=1)

    def cell(row: int, key: ColumnKey) -> tuple[str, Span]:
        return cell_of_row(lines, header, row, places[key])

    units = header.units(places.values())
    return ColumnTable(
        columns=dict(zip(places, found.columns, strict=True)),
        place=place,
        cell=cell,
        units={key: units[index] for key, index in places.items() if index in units},
        begins=found.begins,
    )


def _numbers(path: Path, header: Header, indices: Sequence[int]) -> list[FloatArray] | None:
    """The columns read by numpy; None if the file has anything but plain rows of numbers."""
    dialect = header.dialect
    # numpy knows neither commas as decimals nor lines of comments that count as none
    if dialect.decimal != "." or dialect.comment is not None:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # no data rows; the other reader explains
        try:
            blanks = dialect.delimiter == BLANKS
            table = np.loadtxt(
                path,
                delimiter=None if blanks else dialect.delimiter,
                skiprows=header.skipped,
                usecols=None if blanks else indices,
                comments=None,
                encoding="utf-8-sig",
                ndmin=2,
            )
        except UnicodeDecodeError:
            # a ValueError too, yet the file is wrong and not its numbers
            raise
        except ValueError:
            return None
    if not len(table):
        return None
    # of a lone column a blank line is a missing value, and numpy passes over it
    if header.width == 1 and _lines_below(path, header) != len(table):
        return None
    if blanks:  # all columns were read, so that rows of another width are seen
        whole = table.shape[1] == header.width
        return [np.ascontiguousarray(table[:, i]) for i in indices] if whole else None
    # a row with a cell too many or too few shifts the columns, and numpy sees only those it reads
    if _delimiters(path, header) != len(table) * (header.width - 1):
        return None
    return [np.ascontiguousarray(column) for column in table.T]


def _delimiters(path: Path, header: Header) -> int:
    """The number of delimiters after the header: a check of columns that loadtxt skips."""
    return _count(path, header, header.dialect.delimiter.encode())


def _lines_below(path: Path, header: Header) -> int:
    """The number of lines after the header."""
    with path.open("rb") as file:
        file.seek(-1, SEEK_END)
        is_ended = file.read(1) == b"\n"
    return _count(path, header, b"\n") + (not is_ended)


def _count(path: Path, header: Header, sign: bytes) -> int:
    total = 0
    with path.open("rb") as file:
        for _ in range(header.skipped):
            file.readline()
        # bytes: a delimiter is one byte in UTF-8, which no other letter contains
        while chunk := file.read(_CHUNK):
            total += chunk.count(sign)
    return total


def _complete(
    columns: Sequence[FloatArray], keys: Sequence[ColumnKey], optional: frozenset[ColumnKey]
) -> bool:
    for key, column in zip(keys, columns, strict=True):
        # infinite is a fault even where a value may be missing
        fine = ~np.isinf(column) if key in optional else np.isfinite(column)
        if not fine.all():
            return False
    return True
