"""Reads the columns of a file, with valid names and units for a spec."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.data.formats.table import ColumnTable, WantedColumns
from msnn.data.formats.table_of_formats import format_of, require_reader
from msnn.data.formats.text.csv_header import Dialect, content_lines, header_cells, split_cells
from msnn.data.formats.text.text_encoding import not_utf8, refuse_other_formats
from msnn.data.formats.text.xlsx_file import WORKBOOK, sheet_lines
from msnn.data.formats.written_units import (
    MISSING,
    CapitalUnit,
    MixedUnits,
    TwoUnits,
    is_case_kept,
    is_number,
    is_unit,
    plain_label,
    without_brackets,
    written_unit,
)
from msnn.errors.data import files as errors
from msnn.features.data_check.errors import no_table
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.expressions.language import BUILTINS
from spec_schema.expressions.moments import read_moment
from spec_schema.names import is_name, normalised, why_reserved
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import ONE, Unit

if TYPE_CHECKING:
    from msnn.data.formats.table_of_formats import Reader


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


_LONGEST_NAME = 40
_OTHER = re.compile("[^A-Za-z0-9_Ͱ-Ͽ]+")
_BESIDE = re.compile(r"\W+")
"""Characters that are letters in no script; a name may have `_` in their place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundColumn:
    """One numeric column."""

    index: int
    label: str
    """Its header."""
    name: str
    """Its name in the spec."""
    unit: Unit | None
    doubt: CapitalUnit | TwoUnits | MixedUnits | None = None
    """The ambiguous or conflicting unit of the file; `unit` is then None."""
    key: str | int
    """The reference in the spec: its header, or its index if the header is not unique."""
    values: FloatArray

    @property
    def moves(self) -> bool:
        known = self.values[np.isfinite(self.values)]
        return len(known) > 1 and float(np.ptp(known)) > 0

    @property
    def is_seldom(self) -> bool:
        """True if most rows lack it or its previous value; as an input it would end every
        episode.
        """
        known = np.isfinite(self.values)
        return 2 * int(np.sum(known[1:] & known[:-1])) < len(known) - 1

    @property
    def doubts(self) -> tuple[str, ...]:
        """A note if the unit is ambiguous."""
        match self.doubt:
            case CapitalUnit(different=units):
                pass
            case TwoUnits(named=named, stated=stated):
                units = (named, stated)
            case MixedUnits(shown=shown):
                units = [one.unit for one in shown if one.unit is not None]
            case None:
                return ()
        texts = " or ".join(unit.text for unit in units)
        return (f"`{self.label}` may be in {texts}: write the unit of `{self.name}`",)

    @property
    def renamed(self) -> str:
        """A note if the name has not all letters of the header; empty otherwise."""
        plain = normalised(plain_label(self.label)[0])
        if not plain or _BESIDE.sub("_", plain).strip("_") == self.name:
            return ""
        return f"`{plain}` is called `{self.name}` in the spec"

    @property
    def how_often(self) -> str:
        known = int(np.isfinite(self.values).sum())
        return f"has a value in {known} of {len(self.values)} rows"


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundTable:
    """The numeric columns of one file, and its other columns."""

    layout: TextLayout
    columns: tuple[FoundColumn, ...]
    texts: tuple[int, ...]
    """Indices of non-numeric columns."""
    dates: FoundColumn | None
    """The first date column, in seconds since the first row."""

    @property
    def rows(self) -> int:
        return len(self.columns[0].values)

    def text_in(self, called: str) -> str | None:
        """The first non-numeric cell of the text column with this header; None if there is none."""
        for index in self.texts:
            label = self.layout.labels[index]
            if called in (label, plain_label(label)[0]):
                cells = [row[index] for row in self.layout.sample if index < len(row)]
                decimal = self.layout.dialect.decimal
                return next((c for c in cells if not number(c, decimal)), None)
        return None


def columns_of(path: Path) -> FoundTable:
    """All numeric columns; SpecError if there are none, or for a non-numeric cell in one."""
    format = format_of(path)
    if format.plugin is not None:
        return _columns_of_plugin(path, replace(format, plugin=format.plugin.of_all()).reader)
    layout = layout_of(path)
    decimal = layout.dialect.decimal
    numbers = [
        index
        for index in range(len(layout.labels))
        if all(number(row[index], decimal) for row in layout.sample if index < len(row))
        # an empty column is no number
        and any(row[index] for row in layout.sample if index < len(row))
    ]
    if not numbers:
        raise SpecError([no_table(path.name)])
    dates = next((i for i in range(len(layout.labels)) if _has_dates(layout, i)), None)
    read = numbers if dates is None else [*numbers, dates]
    wanted = WantedColumns(
        dict.fromkeys(read, "the new spec"),
        optional=frozenset(numbers),
        moments=frozenset(read) - frozenset(numbers),
    )
    table = format_of(path).reader(path, path.name, wanted, layout.dialect)
    assert isinstance(table, ColumnTable), "tables of text and workbooks have one time"
    return _found(layout, table, numbers, dates)


def _columns_of_plugin(path: Path, reader: Reader) -> FoundTable:
    """The columns of a plug-in's format, which needs no layout."""
    named = reader(path, path.name, WantedColumns({}), Dialect())
    assert isinstance(named, ColumnTable), "formats of plug-ins have columns of one length"
    labels = tuple(map(str, named.columns))
    table = ColumnTable(
        columns=dict(enumerate(named.columns.values())),
        units={labels.index(str(key)): unit for key, unit in named.units.items()},
    )
    dates = [index for index, label in enumerate(labels) if label in named.begins]
    numbers = [index for index in range(len(labels)) if index not in dates]
    if not numbers:
        raise SpecError([no_table(path.name)])
    none = ("",) * len(labels)
    layout = TextLayout(dialect=Dialect(), labels=labels, units=none, named=True, sample=())
    return _found(layout, table, numbers, dates[0] if dates else None)


def _found(
    layout: TextLayout, table: ColumnTable, numbers: list[int], dates: int | None
) -> FoundTable:
    names = dict(zip(numbers, _names(layout, numbers), strict=True))

    def column(index: int, unit: Unit | CapitalUnit | TwoUnits | MixedUnits | None) -> FoundColumn:
        return FoundColumn(
            index=index,
            label=layout.labels[index],
            name=names.get(index, "time"),
            unit=unit if isinstance(unit, Unit) else None,
            doubt=None if isinstance(unit, Unit) else unit,
            key=_key(layout, index),
            values=table.columns[index],
        )

    return FoundTable(
        layout=layout,
        columns=tuple(column(index, _unit(layout, table, index)) for index in numbers),
        dates=None if dates is None else column(dates, parse_unit("s")),
        texts=tuple(i for i in range(len(layout.labels)) if i not in names),
    )


def _has_dates(layout: TextLayout, index: int) -> bool:
    cells = [row[index] for row in layout.sample if index < len(row)]
    return len(cells) > 1 and all(read_moment(cell) is not None for cell in cells)


def free_name(wanted: str, taken: set[str]) -> str:
    """A unique name similar to `wanted`, which is added to `taken`."""
    name, number = wanted, 1
    while name in taken:
        number += 1
        name = f"{wanted}_{number}"
    taken.add(name)
    return name


def _names(layout: TextLayout, numbers: list[int]) -> Iterator[str]:
    """A unique name for each column, from the letters and digits of its header."""
    # a signal called `sum` would hide the function in every formula
    taken = set(BUILTINS)
    for index in numbers:
        text = normalised(plain_label(layout.labels[index])[0])
        name = _OTHER.sub("_", text).strip("_")[:_LONGEST_NAME].rstrip("_")
        if not is_name(name):
            name = f"c_{name}" if name else f"column_{index}"
        if why_reserved(name) is not None:
            name = f"{name}_"
        yield free_name(name, taken)


def _unit(
    layout: TextLayout, table: ColumnTable, index: int
) -> Unit | CapitalUnit | TwoUnits | MixedUnits | None:
    text = without_brackets(layout.units[index]) or plain_label(layout.labels[index])[1]
    # no unit: a spec that says `1` would ask the same of all that is added to it
    unit = None if text == "-" else written_unit(text)
    stated = table.units.get(index)  # that of the number formats of a workbook too
    if isinstance(stated, TwoUnits | MixedUnits):
        return stated
    if isinstance(stated, Unit | CapitalUnit) and stated.text != ONE.text:
        unit = stated
    if not isinstance(unit, CapitalUnit):
        return unit
    if unit.written is not None and is_case_kept(unit, layout.labels, layout.units):
        return unit.written
    return unit.different[0] if len(unit.different) == 1 else unit


def _key(layout: TextLayout, index: int) -> str | int:
    """The header if it identifies this column and is not a pattern; else the index."""
    label = layout.labels[index]
    # two columns of one header are told apart by index alone
    named = layout.named and layout.labels.count(label) == 1
    if named and label and label.isprintable() and not set(label) & set("{}"):
        return label
    return index
