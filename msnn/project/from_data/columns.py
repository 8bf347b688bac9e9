"""Reads the columns of a file with names that a spec can have, and their units."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.data.formats.csv_file import read
from msnn.data.formats.table import WantedColumns
from msnn.errors.new_specs import no_table
from msnn.project.from_data.layout import TextLayout, layout_of, number
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.expressions.language import BUILTINS
from spec_schema.names import is_name, normalised, why_reserved
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import Unit, UnitError

_LONGEST_NAME = 40
_MOST_REPAIRS = 3
"""Of one unit: each is a spelling that is known, as `°` and `Nm`."""
_BRACKETS = re.compile(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*", re.DOTALL)
_OTHER = re.compile("[^A-Za-z0-9_Ͱ-Ͽ]+")


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundColumn:
    """One column of numbers."""

    index: int
    label: str
    """What the header says."""
    name: str
    """What the spec calls it."""
    unit: Unit | None
    key: str | int
    """How the spec finds it: by its header, or by its index where that does not name it."""
    values: FloatArray

    @property
    def moves(self) -> bool:
        known = self.values[np.isfinite(self.values)]
        return len(known) > 1 and float(np.ptp(known)) > 0


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundTable:
    """The columns of numbers of one file, and what it has beside them."""

    layout: TextLayout
    columns: tuple[FoundColumn, ...]
    texts: tuple[int, ...]
    """Indices of columns that are not numbers."""

    @property
    def rows(self) -> int:
        return len(self.columns[0].values)


def columns_of(path: Path) -> FoundTable:
    """All columns of numbers; SpecError where there are none, or a cell among them is none."""
    layout = layout_of(path)
    decimal = layout.dialect.decimal
    numbers = [
        index
        for index in range(len(layout.labels))
        if all(number(row[index], decimal) for row in layout.sample if index < len(row))
        and any(row[index] for row in layout.sample if index < len(row))
    ]
    if not numbers:
        raise SpecError([no_table(path.name)])
    wanted = WantedColumns(dict.fromkeys(numbers, "the new spec"), frozenset(numbers))
    table = read(path, path.name, wanted, layout.dialect)
    names = dict(zip(numbers, _names(layout, numbers), strict=True))
    return FoundTable(
        layout=layout,
        columns=tuple(
            FoundColumn(
                index=index,
                label=layout.labels[index],
                name=names[index],
                unit=_unit(layout, index),
                key=_key(layout, index),
                values=table.columns[index],
            )
            for index in numbers
        ),
        texts=tuple(i for i in range(len(layout.labels)) if i not in names),
    )


def plain_label(label: str) -> tuple[str, str]:
    """A header without the unit in brackets at its end, and that unit."""
    found = _BRACKETS.fullmatch(label)
    return (found[1], found[2]) if found is not None and found[1] else (label, "")


def free_name(wanted: str, taken: set[str]) -> str:
    """A name like the wanted one that nothing has yet; it is taken then."""
    name, number = wanted, 1
    while name in taken:
        number += 1
        name = f"{wanted}_{number}"
    taken.add(name)
    return name


def _names(layout: TextLayout, numbers: list[int]) -> Iterator[str]:
    """A name of its own for each column: of the header's letters and digits."""
    taken = set(BUILTINS)
    for index in numbers:
        text = normalised(plain_label(layout.labels[index])[0])
        name = _OTHER.sub("_", text).strip("_")[:_LONGEST_NAME].rstrip("_")
        if not is_name(name):
            name = f"c_{name}" if name else f"column_{index}"
        if why_reserved(name) is not None:
            name = f"{name}_"
        yield free_name(name, taken)


def _unit(layout: TextLayout, index: int) -> Unit | None:
    text = layout.units[index].strip("[]()") or plain_label(layout.labels[index])[1]
    text = text.replace("²", "^2").replace("³", "^3")
    for _ in range(_MOST_REPAIRS):
        try:
            return parse_unit(text) if text else None
        except UnitError as error:
            if error.repair is None:
                return None
            text = text[: error.start] + error.repair + text[error.end :]
    return None


def _key(layout: TextLayout, index: int) -> str | int:
    """The header where it names this column alone and is no pattern of several."""
    label = layout.labels[index]
    named = layout.named and layout.labels.count(label) == 1
    if named and label and label.isprintable() and not set(label) & set("{}"):
        return label
    return index
