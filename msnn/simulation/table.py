"""Writes simulations as a table that can be joined with the logs: a row a step."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np

from backends.files.atomic_write import write_text
from compiler.ir.program import Output, Program
from msnn.simulation.simulate import Simulation


def write_simulation(path: Path, program: Program, runs: Sequence[Simulation]) -> Path:
    """Writes file, set, row, time, outputs, and `<output>.log` for each output that predicts.

    `row` and `time` are those of the file, so that the table joins it by `file` and `row`; `row`
    is empty for moments that resampling put between two rows.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    timed = any(run.places.time is not None for run in runs)
    logged = [out for out in program.outputs if any(out.name in run.logged for run in runs)]
    header = [label for out in program.outputs for label in _labels(program, out)]
    header += [f"{label}.log" for out in logged for label in _labels(program, out)]
    writer.writerow(["file", "set", "row", *(["time"] if timed else []), *header])
    for run in runs:
        columns = [run.outputs[out.name].reshape(run.steps, -1) for out in program.outputs]
        for out in logged:
            values = run.logged.get(out.name, np.full(run.outputs[out.name].shape, np.nan))
            columns.append(values.reshape(run.steps, -1))
        table, places = np.concatenate(columns, axis=1), run.places
        for k in range(run.steps):
            row = str(places.rows[k]) if places.joins(k) else ""
            time = [_cell(places.time[k])] if places.time is not None else [""] * timed
            cells = map(_cell, table[k])
            writer.writerow([places.files[k], places.sets[k], row, *time, *cells])
    return write_text(path, text.getvalue())


def run_record(run: Simulation) -> dict[str, object]:
    """Where a run belongs, as data: its first and last step."""
    places, ends = run.places, (0, run.steps - 1)
    return {
        "files": list(dict.fromkeys(places.files)),
        "sets": list(dict.fromkeys(places.sets)),
        "steps": run.steps,
        "rows": [int(places.rows[k]) if places.joins(k) else None for k in ends],
        "time": None if places.time is None else [float(places.time[k]) for k in ends],
    }


def _cell(value: float) -> str:
    return "" if np.isnan(value) else repr(float(value))


def _labels(program: Program, output: Output) -> list[str]:
    """Names of an output's columns: `q_next`, or `q_next[joint1]` for elements."""
    dimensions = {dimension.name: dimension.labels for dimension in program.dimensions}
    axes = program.step[output.node].type.axes
    if not axes:
        return [output.name]
    names = [dimensions.get(axis.name) or tuple(map(str, range(axis.size))) for axis in axes]
    return [f"{output.name}[{','.join(index)}]" for index in product(*names)]
