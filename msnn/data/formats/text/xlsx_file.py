"""Reads the first sheet of an Excel workbook as if it had been saved as text."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import date, datetime
from pathlib import Path

from msnn.data.formats.table import ColumnTable, WantedColumns
from msnn.data.formats.text.csv_file import text_table
from msnn.data.formats.text.csv_header import Dialect, read_header, with_blank_rows
from msnn.data.formats.text.xlsx_cells import first_sheet, units_of_formats
from msnn.data.formats.unpacked_size import refuse_unpacking
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import SpecError

WORKBOOK = ".xlsx"
_CELLS = "\t"


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> ColumnTable:
    """The requested columns; messages count rows from the header and lines from the sheet's top.

    Numbers are the workbook's doubles, formulas have their last saved values. Raises SpecError with
    all errors of the sheet.
    """
    # once: a workbook is unpacked and parsed each time it is opened
    every = list(sheet_lines(path, dialect, shown, blank=True))
    found = [(number, text) for number, text in every if text]
    own = Dialect(delimiter=_CELLS, comment=dialect.comment, header=dialect.header, is_text=False)

    def lines() -> Iterator[tuple[int, str]]:
        return iter(found)

    header = read_header(lines, shown, own, wanted.users)
    places = header.places(wanted)
    shown_units = units_of_formats(path, set(places.values()), header.skipped)
    header = replace(header, shown_units=shown_units)
    if header.width == 1:
        rows = with_blank_rows(lambda: iter(every), header)
        return text_table(rows, header, places, wanted)
    return text_table(lines, header, places, wanted)


def sheet_lines(
    path: Path, dialect: Dialect, shown: str, *, blank: bool = False
) -> Iterator[tuple[int, str]]:
    """Number and text of the rows after `skip` that are neither comments nor empty.

    With `blank`, empty rows are included as empty texts.
    """
    for number, text in _sheet(path, shown):
        plain = text.lstrip()
        comment = dialect.comment is not None and plain.startswith(dialect.comment)
        if number > dialect.skip and not comment and (plain or blank):
            yield number, text if plain else ""


def _sheet(path: Path, shown: str) -> Sequence[tuple[int, str]]:
    """The rows of the first sheet with their numbers; cells are separated by tabs."""
    try:
        with zipfile.ZipFile(path) as book:
            unpacked = sum(part.file_size for part in book.infolist())
        # XML is packed by 10, and parsed at a tenth of the speed of numbers
        refuse_unpacking(path, shown, unpacked, free=1 << 26, times_size=50)
        with first_sheet(path) as sheet:
            rows = [[_text(cell) for cell in row] for row in sheet.iter_rows(values_only=True)]
        if _has_formulas(path):
            _show_formulas(path, rows)
    except SpecError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise SpecError((errors.unreadable_file(shown, reason),)) from error
    except Exception as error:
        # what is broken in the archive shows as whatever its parser met first
        said = (str(error).splitlines() or [""])[0][:80]
        reason = f"it is not a workbook that can be read ({said})"
        raise SpecError((errors.unreadable_file(shown, reason),)) from error
    _refuse_scattered(rows, shown)
    width = max(map(len, rows), default=0)
    return [
        # rows end at their last cell; the table has as many columns as its longest row
        (number, _CELLS.join([*row, *[""] * (width - len(row))]) if any(row) else "")
        for number, row in enumerate(rows, start=1)
    ]


_MOST_EMPTY = 10_000_000
"""Maximum number of empty cells: a sparse table of 100,000 rows and 100 columns."""


def _refuse_scattered(rows: Sequence[Sequence[str]], shown: str) -> None:
    """Raises SpecError for a cell so far from the others that the table would be mostly empty."""
    width = max(map(len, rows), default=0)
    filled = sum(map(bool, rows))
    cells = sum(cell != "" for row in rows for cell in row)
    alone = len(rows) > _FAR and width > _FAR and cells < width
    if width * filled - cells <= _MOST_EMPTY and not alone:
        return
    row, cells_there = max(enumerate(rows, start=1), key=lambda each: len(each[1]))
    reason = f"row {row} has a cell in column {len(cells_there)}, far from the others"
    raise SpecError((errors.unreadable_file(shown, reason, "remove that cell"),))


_FAR = 1000
"""Rows and columns beyond which a single cell is considered stray."""


def _has_formulas(path: Path) -> bool:
    with zipfile.ZipFile(path) as book:
        sheets = (name for name in book.namelist() if name.startswith("xl/worksheets/"))
        # an opening tag of a formula: opening the workbook twice takes twice as long, and few need
        # it
        return any(b"<f" in book.read(name) for name in sheets)


def _show_formulas(path: Path, rows: list[list[str]]) -> None:
    """Replaces missing results of formulas by the formulas' texts, so that they are reported.

    Without a saved value, a formula would be read as an empty cell, i.e. as a missing measurement.
    """
    with first_sheet(path) as shown, first_sheet(path, data_only=False) as written:
        both = zip(rows, shown.iter_rows(), written.iter_rows(), strict=True)
        for texts, values, formulas in both:
            for index, (value, formula) in enumerate(zip(values, formulas, strict=True)):
                # a formula whose value is an empty text was computed: that is of another type
                if formula.data_type == "f" and value.value is None and value.data_type == "n":
                    texts[index] = _text(formula.value)


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
