"""Reads the first sheet of an Excel workbook as the table of text that it would be saved as."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import date, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from msnn.data.formats.table import ColumnTable, WantedColumns
from msnn.data.formats.text.csv_file import text_table
from msnn.data.formats.text.csv_header import Dialect, read_header
from msnn.data.formats.text.xlsx_units import units_of_formats
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import SpecError

WORKBOOK = ".xlsx"
_CELLS = "\t"


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> ColumnTable:
    """The wanted columns; rows in messages are those below the header, lines those of the sheet.

    Numbers are the doubles of the workbook, formulas the values they had when it was saved. Raises
    SpecError with all faults of the sheet.
    """
    # once: a workbook is unpacked and parsed each time it is opened
    found = list(sheet_lines(path, dialect, shown))

    def lines() -> Iterator[tuple[int, str]]:
        return iter(found)

    own = Dialect(delimiter=_CELLS, comment=dialect.comment, header=dialect.header)
    header = read_header(lines, shown, own, wanted.users)
    header = replace(header, shown_units=units_of_formats(path))
    return text_table(lines, header, header.places(wanted), wanted)


def sheet_lines(
    path: Path, dialect: Dialect, shown: str | None = None
) -> Iterator[tuple[int, str]]:
    """Number and text of the rows after `skip` that are not empty and no comment."""
    for number, text in _sheet(path, shown or path.name):
        plain = text.lstrip()
        comment = dialect.comment is not None and plain.startswith(dialect.comment)
        if number > dialect.skip and plain and not comment:
            yield number, text


def _sheet(path: Path, shown: str) -> Sequence[tuple[int, str]]:
    """The rows of the first sheet with their numbers, cells apart by tabs."""
    # an optional package without types
    openpyxl: Any = import_module("openpyxl")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # styles that it does not know
            book: Any = openpyxl.load_workbook(path, read_only=True, data_only=True)
            sheet: Any = book.worksheets[0]
            sheet.reset_dimensions()  # a size that the file states may be smaller than the sheet
            rows = [[_text(cell) for cell in row] for row in sheet.iter_rows(values_only=True)]
            book.close()
            if _has_formulas(path):
                _show_formulas(openpyxl, path, rows)
    except OSError as error:
        reason = error.strerror or str(error)
        raise SpecError((errors.unreadable_file(shown, reason),)) from error
    except Exception as error:
        # what is broken in the archive shows as whatever its parser met first
        reason = f"it is not a workbook that can be read ({str(error).splitlines()[0][:80]})"
        raise SpecError((errors.unreadable_file(shown, reason),)) from error
    width = max(map(len, rows), default=0)
    return [
        # rows end at their last cell; the table has as many columns as its longest row
        (number, _CELLS.join([*row, *[""] * (width - len(row))]))
        for number, row in enumerate(rows, start=1)
    ]


def _has_formulas(path: Path) -> bool:
    with zipfile.ZipFile(path) as book:
        sheets = (name for name in book.namelist() if name.startswith("xl/worksheets/"))
        # an opening tag of a formula: opening the workbook twice takes twice as long, and few need
        # it
        return any(b"<f" in book.read(name) for name in sheets)


def _show_formulas(openpyxl: Any, path: Path, rows: list[list[str]]) -> None:
    """Puts formulas in the place of values that nobody has computed and saved.

    They would read as cells that are empty, which is a measurement that was not made.
    """
    books = [
        openpyxl.load_workbook(path, read_only=True, data_only=values) for values in (True, False)
    ]
    sheets = [book.worksheets[0] for book in books]
    for sheet in sheets:
        sheet.reset_dimensions()
    both = zip(*(sheet.iter_rows() for sheet in sheets), strict=True)
    for texts, (values, formulas) in zip(rows, both, strict=True):
        for index, (value, formula) in enumerate(zip(values, formulas, strict=True)):
            # a formula whose value is an empty text was computed: that is of another type
            if formula.data_type == "f" and value.value is None and value.data_type == "n":
                texts[index] = _text(formula.value)
    for book in books:
        book.close()


def _text(cell: object) -> str:
    match cell:
        case None:
            return ""
        # before numbers: True is an int in Python
        case bool():
            return str(int(cell))
        case float():
            # the shortest text that reads back as the same double
            return repr(cell)
        case datetime() | date():
            return cell.isoformat()
        case _:
            # what would be taken for a delimiter, a line or a quote
            return str(cell).replace(_CELLS, " ").replace("\n", " ").replace('"', "'").strip()
