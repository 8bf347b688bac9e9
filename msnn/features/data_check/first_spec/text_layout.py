"""Infers the layout of a text file: delimiter, decimal sign, header, line of units."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from msnn.data.formats.table_of_formats import format_of, require_reader
from msnn.data.formats.text.csv_header import (
    Dialect,
    content_lines,
    header_cells,
    split_cells,
)
from msnn.data.formats.text.text_encoding import not_utf8, refuse_other_formats
from msnn.data.formats.text.xlsx_file import WORKBOOK, sheet_lines
from msnn.data.formats.written_units import MISSING, is_number, is_unit
from msnn.errors.data import files as errors
from msnn.features.data_check.errors.first_specs import no_table
from spec_schema.diagnostics.diagnostic import SpecError

# enough for headers of loggers and rows to judge by
_LINES = 400
# in the order of how common they are: max() takes the first of those that fit alike
_DIALECTS = ((",", "."), (";", "."), ("\t", "."), ("|", "."), (";", ","), ("\t", ","), (" ", "."))
_COMMENTS = ("#", "%")


@dataclass(frozen=True, slots=True, kw_only=True)
class TextLayout:
    """The layout of a text file in terms of the `csv:` key, and its header."""

    dialect: Dialect
    labels: tuple[str, ...]
    """The cells of the header; empty texts without a header."""
    units: tuple[str, ...]
    """The cells of the line of units; empty texts without one."""
    named: bool
    """True if columns can be referenced by header; False if a line of units must be skipped."""
    sample: tuple[tuple[str, ...], ...]
    """The cells of the first rows."""


def layout_of(path: Path) -> TextLayout:
    """The layout of a file of numbers; SpecError for other files."""
    comment = _comment(path)
    lines = _first_lines(path, Dialect(comment=comment))
    if not lines:
        raise SpecError([errors.empty_file(path.name, header=False)])
    texts = [text for _, text in lines]
    delimiter, decimal = max(_DIALECTS, key=lambda signs: _fits(texts, *signs))
    rows = [header_cells(text, delimiter) for text in texts]
    # the second half: whatever stands above the table is shorter than that
    width = Counter(map(len, rows[len(rows) // 2 :])).most_common(1)[0][0]
    numeric = _numeric([row for row in rows[len(rows) // 2 :] if len(row) == width], decimal)
    first = next((i for i, row in enumerate(rows) if _is_data(row, width, numeric, decimal)), None)
    if first is None or not numeric:
        raise SpecError([no_table(path.name)])
    above = [i for i in range(first) if len(rows[i]) == width]
    header = above[-1] if above else None
    units: tuple[str, ...] = ("",) * width
    # a line of units stands right above the numbers, and the header above it
    if len(above) > 1 and above[-1] == first - 1 and all(is_unit(cell) for cell in rows[first - 1]):
        units, header = rows[first - 1], above[-2]
    named = header is not None and not any(units)
    begins = lines[header][0] if header is not None and named else lines[first][0]
    # comments are passed over after the lines that are skipped
    before = begins - 1 if (header if named else first) else 0
    return TextLayout(
        dialect=Dialect(
            delimiter=delimiter, decimal=decimal, comment=comment, header=named, skip=before
        ),
        labels=_labels_in_comment(path, comment, delimiter, width)
        if header is None
        else rows[header],
        units=units,
        named=named,
        sample=tuple(rows[first:]),
    )


def number(cell: str, decimal: str) -> bool:
    """True if a cell is a number or a marker for a missing value."""
    return cell.lower() in MISSING or is_number(cell.replace(decimal, "."))


def _first_lines(path: Path, dialect: Dialect) -> list[tuple[int, str]]:
    require_reader(path)
    is_workbook = path.suffix.lower() == WORKBOOK
    if not is_workbook:
        format = format_of(path)
        if not format.is_text:
            raise SpecError([no_table(path.name, format.name)])
        refuse_other_formats(path, path.name)
    try:
        lines = sheet_lines if is_workbook else content_lines
        return list(islice(lines(path, dialect, path.name), _LINES))
    except UnicodeDecodeError as error:
        raise SpecError([not_utf8(path, path.name, error)]) from error


def _labels_in_comment(
    path: Path, comment: str | None, delimiter: str, width: int
) -> tuple[str, ...]:
    """The header in a comment, as numpy writes it; empty texts without one."""
    if comment is not None:
        for _, text in _first_lines(path, Dialect()):
            # `# t,x,y`, as numpy.savetxt writes it
            cells = split_cells(text.lstrip().lstrip(comment), delimiter)
            if text.lstrip().startswith(comment) and len(cells) == width:
                return tuple(cell.strip() for cell in cells)
    return ("",) * width


def _comment(path: Path) -> str | None:
    """The comment character of lines above the table, if there is one."""
    lines = [text.lstrip() for _, text in _first_lines(path, Dialect())]
    for sign in _COMMENTS:
        begins = [line.startswith(sign) for line in lines]
        # a file of nothing else has no table; the sign belongs to its cells
        if any(begins) and not all(begins):
            return sign
    return None


def _fits(texts: Sequence[str], delimiter: str, decimal: str) -> tuple[float, int]:
    """Quality of a layout: fraction of numeric cells in lines of one width, and that width."""
    rows = [split_cells(text, delimiter) for text in texts]
    late = rows[len(rows) // 2 :]
    width, count = Counter(map(len, late)).most_common(1)[0]
    cells = [cell.strip() for row in late if len(row) == width for cell in row]
    numbers = sum(is_number(cell.replace(decimal, ".")) for cell in cells)
    empty = sum(cell.lower() in MISSING for cell in cells)
    # an empty cell counts half: it fits, and says less than a number
    share = (numbers + 0.5 * empty) / max(len(cells), 1) * count / len(late)
    # text in a column or two is no sign of another delimiter
    return (round(share, 2) if width == 1 else share + 0.5 if numbers else 0.0, width)


def _numeric(rows: Sequence[Sequence[str]], decimal: str) -> tuple[int, ...]:
    """The columns with numbers in most rows."""
    found: list[int] = []
    for index in range(len(rows[0]) if rows else 0):
        cells = [row[index] for row in rows if row[index].lower() not in MISSING]
        numbers = sum(is_number(cell.replace(decimal, ".")) for cell in cells)
        if numbers and 2 * numbers >= len(cells):
            found.append(index)
    return tuple(found)


def _is_data(row: Sequence[str], width: int, numeric: Sequence[int], decimal: str) -> bool:
    """True if a line has a number, or a missing value, in every numeric column."""
    if len(row) != width or not all(number(row[index], decimal) for index in numeric):
        return False
    return any(row[index].lower() not in MISSING for index in numeric)
