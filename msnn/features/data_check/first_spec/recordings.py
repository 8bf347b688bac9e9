"""Reads the files of a new spec as recordings of one set."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.reading.resample import longest_step
from msnn.data.reading.rows import GAP_TOLERANCE
from msnn.features.data_check.errors import no_such_files, unlike_files
from msnn.features.data_check.first_spec.columns import FoundTable, columns_of
from msnn.features.data_check.first_spec.time_column import FoundTime, time_of
from msnn.features.data_check.sampling import follows
from spec_schema.diagnostics.diagnostic import SpecError


@dataclass(frozen=True, slots=True, kw_only=True)
class Recordings:
    """Files with the same columns and sample time, one after the other."""

    files: tuple[Path, ...]
    table: FoundTable
    """That of the first file, with the values of all."""
    time: FoundTime
    follows: BoolArray
    """True for a row one sample after the previous one of the same file."""
    held_out: BoolArray
    """True for the last rows of each file."""
    rows: int
    """Rows of the files, before they are brought to the sample time."""


def files_of(patterns: Sequence[Path]) -> tuple[Path, ...]:
    """The files that paths and patterns such as `logs/*.csv` name, each once.

    Raises SpecError for a pattern without files.
    """
    found: dict[Path, None] = {}
    for pattern in patterns:
        if pattern.exists() or not glob.has_magic(str(pattern)):
            found[pattern] = None
            continue
        below = pattern.relative_to(pattern.anchor)
        matches = sorted(p for p in Path(pattern.anchor).glob(str(below)) if p.is_file())
        if not matches:
            raise SpecError([no_such_files(str(pattern))])
        found |= dict.fromkeys(matches)
    return tuple(found)


def recordings_of(files: Sequence[Path], held_out: float) -> Recordings:
    """The recordings in files; the last share `held_out` of each is for validation.

    Raises SpecError for a file without columns of numbers, and for files with other columns, units
    or sample times than the first.
    """
    tables = [columns_of(file) for file in files]
    times = [time_of(table, file.name) for table, file in zip(tables, files, strict=True)]
    for file, table, time in zip(files[1:], tables[1:], times[1:], strict=True):
        if why := _difference(tables[0], times[0], table, time):
            raise SpecError([unlike_files(files[0].name, file.name, why)])
    methods = [time.resample for time in times]
    # one key for all files: `linear` deals with gaps too
    resample = next((m for m in ("linear", "none") if m in methods), None)
    time = replace(
        times[0],
        resample=resample,
        notes=tuple(dict.fromkeys(note for each in times for note in each.notes)),
    )
    parts = [
        _on_grid(table, each, time) if resample == "linear" else _as_written(table, each)
        for table, each in zip(tables, times, strict=True)
    ]
    columns = tuple(
        replace(column, values=np.concatenate([part[0][i] for part in parts]))
        for i, column in enumerate(tables[0].columns)
    )
    late = [np.arange(len(part[1])) >= int((1 - held_out) * len(part[1])) for part in parts]
    return Recordings(
        files=tuple(files),
        table=replace(tables[0], columns=columns),
        time=time,
        follows=np.concatenate([part[1] for part in parts]),
        held_out=np.concatenate(late),
        rows=sum(table.rows for table in tables),
    )


def _difference(
    first: FoundTable, first_time: FoundTime, table: FoundTable, time: FoundTime
) -> str:
    """The reason why a file is no recording of the same set; empty if it is one."""
    keys = {column.key: column for column in first.columns}
    others = {column.key: column for column in table.columns}
    if lacking := [str(key) for key in keys if key not in others]:
        return f"it has no column of numbers `{lacking[0]}`"
    if more := [str(key) for key in others if key not in keys]:
        return f"it has a column of numbers `{more[0]}` more"
    for key, column in keys.items():
        units = [c.unit.text if c.unit is not None else "no unit" for c in (column, others[key])]
        if units[0] != units[1]:
            return f"its column `{key}` has {units[1]}, there it has {units[0]}"
        if column.index != others[key].index and isinstance(key, int):
            return "its columns are in another order and have no names"
    if first.layout.dialect != table.layout.dialect:
        return "it has another delimiter, decimal sign, comment or header"
    one, other = first_time, time
    if (one.column and one.column.key) != (other.column and other.column.key):
        return "its time is in another column"
    if one.unit != other.unit or abs(one.step - other.step) > GAP_TOLERANCE * one.step:
        return f"its rows are {other.step:.6g} s apart, there they are {one.step:.6g} s apart"
    return ""


def _as_written(table: FoundTable, time: FoundTime) -> tuple[list[FloatArray], BoolArray]:
    clock = None if time.column is None else time.column.values
    return [column.values for column in table.columns], follows(clock, table.rows)


def _on_grid(
    table: FoundTable, own: FoundTime, time: FoundTime
) -> tuple[list[FloatArray], BoolArray]:
    """The columns at even times by linear interpolation; NaN over holes."""
    if own.column is None:
        # rows without times are one sample apart
        return _as_written(table, own)
    clock = own.column.values * own.scale
    order = np.argsort(clock, kind="stable")
    clock = clock[order]
    grid = np.arange(clock[0], clock[-1] + 1e-9 * time.step, time.step)
    values = [on_times(clock, column.values[order], grid, time.step) for column in table.columns]
    return values, np.arange(len(grid)) > 0


def on_times(clock: FloatArray, values: FloatArray, grid: FloatArray, step: float) -> FloatArray:
    """Values at other times, on lines between the measured ones; NaN over holes and outside.

    Holes are those of `resample: linear`, which the new spec has.
    """
    known = np.isfinite(values) & np.isfinite(clock)
    clock, values = clock[known], values[known]
    if len(clock) < 2:
        return np.full(len(grid), np.nan)
    found = np.interp(grid, clock, values, left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(clock, grid), 1, len(clock) - 1)
    in_hole = np.diff(clock)[after - 1] > longest_step(clock, step)
    found[in_hole & ~np.isin(grid, clock)] = np.nan
    return found
