"""Uses complete arrays of a mapping that have the name and unit of a signal."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.ir.program import Signal
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.reading.columns import LOG_SUFFIX
from msnn.errors.data.formats import unusable_array
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.sections.data import Column, ColumnName, Source


def with_whole_signals(
    arrays: NamedArrays, layout: Source, signals: Iterable[Signal], findings: Findings
) -> tuple[NamedArrays, Source]:
    """The arrays of a mapping, and a layout in which each signal refers to existing columns.

    A signal without the spec's columns uses the array with its own name, (rows, *shape). Without
    the spec's time column, rows are one sample apart.
    """
    columns, flat = dict(layout.columns), set[str]()
    for signal in signals:
        name = signal.name.removesuffix(LOG_SUFFIX)
        column = layout.columns.get(signal.name, layout.columns.get(name))
        # `x.meas` before `x`, as the log of a state is meant
        own = next((n for n in (signal.name, name) if n in arrays.names), None)
        if own is None or (column is not None and _has(arrays, column)):
            continue
        shape = tuple(axis.size for axis in signal.axes)
        found = arrays.get(own).shape
        if found[1:] != shape:
            reason = f"its shape {found} is not (rows, {', '.join(map(str, shape))})"
            # a scalar may lie as (rows, 1) or (1, rows), which `_column` takes
            if shape or not _is_column(found):
                user = f"`{signal.name}`"
                findings.report(unusable_array(own, arrays.file, user, reason))
                continue
        columns[signal.name] = _whole(own, shape, layout)
        if shape:
            flat.add(own)
    time = layout.time
    if time is not None and not arrays.has(time.column.column):
        time = None
    layout = layout.model_copy(update={"columns": columns, "time": time})
    return replace(arrays, get=_flattened(arrays.get, flat)), layout


def _has(arrays: NamedArrays, column: Column) -> bool:
    return all(arrays.has(part.column) for part in column.column)


def _is_column(shape: tuple[int, ...]) -> bool:
    """True if an array has one value per row: shape (n,), (n, 1) or (1, n)."""
    return len(shape) == 1 or (len(shape) == 2 and 1 in shape)


def _whole(name: str, shape: tuple[int, ...], layout: Source) -> Column:
    """The columns of one array: `q[0]`, `q[1]`, …, or `q` itself for a scalar."""
    names = [f"{name}[{i}]" for i in range(math.prod(shape))] if shape else [name]
    # C order, as `Feed.series` puts columns together again
    parts = tuple(ColumnName(part, layout.place.value) for part in names)
    return Column.model_construct(place=layout.place, column=parts)


def _flattened(
    get: Callable[[str], NDArray[Any]], names: set[str]
) -> Callable[[str], NDArray[Any]]:
    def flattened(name: str) -> NDArray[Any]:
        array = np.asarray(get(name))
        return array.reshape(len(array), -1) if name in names else array

    return flattened
