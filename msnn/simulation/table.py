"""Writes simulations as a table that can be joined with the data: one row per step."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from backends.files.atomic_write import replacing
from compiler.ir.program import Output, Program
from msnn.data.dataset import BETWEEN_ROWS, FloatArray
from msnn.simulation.simulate import Simulation

_ROWS = 8192
"""Rows formatted at once; limits the memory."""


def write_simulation(path: Path, program: Program, runs: Sequence[Simulation]) -> Path:
    """Writes columns file, set, row, time, outputs, and `<output>.log` for each prediction.

    Prediction intervals add `<output>.low` and `<output>.high`. `row` is the row of the file, so
    the table can be joined by `file` and `row`; it is empty for resampled times between rows.
    `time` is that of the file. In files joined by their dates, it continues from the first file.
    """
    header, rows = simulation_rows(program, runs)
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
    return path


def simulation_rows(
    program: Program, runs: Sequence[Simulation]
) -> tuple[list[str], Iterator[tuple[object, ...]]]:
    """The header of the table, and an iterator over its rows; "" is a missing value."""
    timed = any(run.places.time is not None for run in runs)
    logged = [out for out in program.outputs if any(out.name in run.logged for run in runs)]
    header = [label for out in program.outputs for label in _labels(program, out)]
    header += [f"{label}.log" for out in logged for label in _labels(program, out)]
    banded = [out for out in program.outputs if any(out.name in run.bands for run in runs)]
    for end in ("low", "high"):
        header += [f"{label}.{end}" for out in banded for label in _labels(program, out)]
    pieces = (
        (run, slice(begin, min(begin + _ROWS, run.steps)))
        for run in runs
        for begin in range(0, run.steps, _ROWS)
    )
    rows = (
        row
        for run, steps in pieces
        for row in _rows(program, run, steps, logged, banded, timed=timed)
    )
    return ["file", "set", "row", *(["time"] if timed else []), *header], rows


def run_record(run: Simulation) -> dict[str, object]:
    """The place of a run as JSON values: its first and last step."""
    places, ends = run.places, (0, run.steps - 1)
    return {
        "files": list(dict.fromkeys(places.files)),
        "sets": list(dict.fromkeys(places.sets)),
        "steps": run.steps,
        "rows": [int(places.rows[k]) if places.joins(k) else None for k in ends],
        "time": None if places.time is None else [float(places.time[k]) for k in ends],
    }


def _rows(
    program: Program,
    run: Simulation,
    steps: slice,
    logged: Sequence[Output],
    banded: Sequence[Output],
    *,
    timed: bool,
) -> Iterable[tuple[object, ...]]:
    """Some rows of the table; numbers are formatted by `repr`."""
    places, count = run.places, steps.stop - steps.start
    found = [run.outputs[out.name][steps] for out in program.outputs]
    for out in logged:
        there = run.logged.get(out.name)
        shape = (count, *run.outputs[out.name].shape[1:])
        found.append(np.full(shape, np.nan) if there is None else there[steps])
    for sign in (-1.0, 1.0):
        found += [run.outputs[o.name][steps] + sign * run.bands[o.name][steps] for o in banded]
    numbers = np.concatenate([values.reshape(count, -1) for values in found], axis=1)
    rows = ["" if row == BETWEEN_ROWS else row for row in places.rows[steps].tolist()]
    columns: list[Sequence[object]] = [places.files[steps], places.sets[steps], rows]
    if timed:
        columns.append([""] * count if places.time is None else _cells(places.time[steps]))
    return zip(*columns, *map(_cells, numbers.T), strict=True)


def _cells(values: FloatArray) -> Sequence[object]:
    missing = np.isnan(values)
    # Python's floats, which csv writes by repr: the shortest text that reads back as the same
    # number
    cells: list[object] = values.tolist()
    for index in np.flatnonzero(missing).tolist():
        cells[index] = ""
    return cells


def _labels(program: Program, output: Output) -> list[str]:
    """Names of an output's columns: `q_next`, or `q_next[joint1]` per element."""
    dimensions = {dimension.name: dimension.labels for dimension in program.dimensions}
    axes = program.step[output.node].type.axes
    if not axes:
        return [output.name]
    # by label where the spec has some
    names = [dimensions.get(axis.name) or tuple(map(str, range(axis.size))) for axis in axes]
    return [f"{output.name}[{','.join(index)}]" for index in product(*names)]
