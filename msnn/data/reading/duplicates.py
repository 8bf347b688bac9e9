"""Makes one row of successive rows with the same time, as `duplicates:` says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from msnn.data.dataset import FloatArray, IntArray
from msnn.data.formats.table import ColumnKey, ColumnTable, Streams
from spec_schema.diagnostics.source import Span

Duplicates = Literal["first", "last", "mean", "error"]


@dataclass(frozen=True, slots=True)
class RemainingRows:
    """The row in the file of each remaining row, and the number of rows in the file."""

    rows: IntArray
    count: int


def without_duplicates(
    read: ColumnTable | Streams, how: Duplicates | None
) -> tuple[ColumnTable | Streams, Mapping[ColumnKey, RemainingRows]]:
    """The columns of a file with one row per time, and the remaining rows of each column.

    Rows are duplicates if they follow each other and their times in seconds are equal. `first` and
    `last` keep a row as it is. `mean` gives each column the mean of its values that were measured,
    NaN if none was. `error` and None change nothing: such times are errors later. The mapping is
    empty if nothing was removed.
    """
    if how is None or how == "error":
        return read, {}
    if isinstance(read, Streams):
        columns: dict[ColumnKey, tuple[FloatArray, FloatArray]] = {}
        remaining: dict[ColumnKey, RemainingRows] = {}
        for key, (time, values) in read.columns.items():
            begins, kept = _groups(time, how)
            columns[key] = (time[begins], _one_per_group(values, begins, kept, how))
            remaining[key] = RemainingRows(kept, len(time))
        if all(len(rows.rows) == rows.count for rows in remaining.values()):
            return read, {}
        return replace(read, columns=columns), remaining
    if read.time is None:
        return read, {}
    begins, kept = _groups(read.time, how)
    if len(begins) == read.rows:
        return read, {}

    def place(row: int) -> Span | None:
        return read.place(int(kept[row]))

    def cell(row: int, key: ColumnKey) -> tuple[str, Span | None]:
        return read.cell(int(kept[row]), key)

    table = replace(
        read,
        columns={k: _one_per_group(v, begins, kept, how) for k, v in read.columns.items()},
        time=read.time[begins],
        place=place,
        cell=cell,
    )
    return table, dict.fromkeys(table.columns, RemainingRows(kept, read.rows))


def _groups(time: FloatArray, how: Duplicates) -> tuple[IntArray, IntArray]:
    """The first row of each group of rows with the same time, and the row that stands for it."""
    begins = np.flatnonzero(np.append(np.ones(min(len(time), 1), np.bool_), np.diff(time) != 0))
    last = np.append(begins[1:], len(time))[: len(begins)] - 1
    return begins, last if how == "last" else begins


def _one_per_group(
    values: FloatArray, begins: IntArray, kept: IntArray, how: Duplicates
) -> FloatArray:
    """The value of each group."""
    if how != "mean" or not len(values):
        return values[kept]
    measured = ~np.isnan(values)
    counts = np.add.reduceat(measured, begins, dtype=np.int64)
    # relative to one of its values, so that the mean of equal values is that value
    level = np.fmax.reduceat(values, begins)
    sizes = np.diff(np.append(begins, len(values)))
    excess = np.where(measured, values - np.repeat(level, sizes), 0.0)
    return level + np.add.reduceat(excess, begins) / np.maximum(counts, 1)
