"""Runs a program freely over whole records: outputs as arrays, and as a CSV file."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from backends.files.atomic_write import write_text
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.liveness import states_beside_the_log
from compiler.ir.program import Output, Program, Role
from compiler.passes.close_loop import close_loop
from msnn.data.dataset import Dataset, FloatArray, Record
from msnn.data.reads import reads
from msnn.data.starts import reach, rollouts
from msnn.errors.workflow import records_too_short
from msnn.simulation.rollout import moments
from spec_schema.diagnostics.diagnostic import SpecError


@dataclass(frozen=True, slots=True)
class Simulation:
    """A free run over one stretch of a record without gap; arrays are (steps, *shape)."""

    record: Record
    first: int
    """Row of the record at which the first step was evaluated."""
    outputs: Mapping[str, FloatArray]
    logged: Mapping[str, FloatArray]
    """What was measured of the signal that an output predicts; only where the data has it."""


def simulation_program(program: Program, close: Iterable[str] | None = None) -> Program:
    """The program that `simulate` runs: loops closed, losses and their targets dropped.

    `close` None closes every input that an output predicts. Load its data with this program: it
    asks for no column that the run does not read. Raises LoopError.
    """
    if close is None:
        inputs = {signal.name for signal in program.signals if signal.role is Role.INPUT}
        predicted = (out.predicts.signal for out in program.outputs if out.predicts is not None)
        close = dict.fromkeys(name for name in predicted if name in inputs)
    closed = close_loop(program, tuple(close))
    beside = states_beside_the_log(closed.step, {s.name: s.next for s in closed.states})
    kept = tuple(state for state in closed.states if state.name not in beside)
    closed = replace(closed, losses=(), fits=(), states=kept)
    wanted = [output.node for output in closed.outputs] + [state.next for state in closed.states]
    read = {**reads(closed.step, wanted)}
    read |= reads(closed.start, [state.start for state in closed.states])
    return replace(closed, signals=tuple(s for s in closed.signals if s.name in read))


def simulate(
    program: Program,
    data: Dataset,
    weights: Mapping[str, FloatArray] | None = None,
    horizon: int | None = None,
) -> list[Simulation]:
    """Free runs over all stretches of the data, each from its first possible row.

    `program` is in window form; what it closes is fed back, what it leaves open is read from the
    data. `horizon` ends every run after so many steps. Runs in float64. Raises SpecError where
    every stretch is too short.
    """
    judge = Interpreter(program, weights)
    # targets of `predicts` need not be there: a simulation may run past the last of them
    unscored = replace(program, outputs=tuple(replace(o, predicts=None) for o in program.outputs))
    far = reach(unscored)
    runs = rollouts(data.stretches(), far, "record", 1)
    if not len(runs):
        raise SpecError([records_too_short(runs.longest, far.rows(1))])
    if horizon is not None:
        runs = replace(runs, steps=np.minimum(runs.steps, horizon))
    outputs = {
        out.name: np.empty(
            (len(runs), int(runs.steps.max(initial=0)), *program.step[out.node].type.shape)
        )
        for out in program.outputs
    }
    for moment in moments(judge, data.series, runs, losses=False):
        for name, value in moment.values.outputs.items():
            outputs[name][moment.members, moment.number] = value
    return [
        _simulation(program, data, int(t0), {n: v[i, :steps] for n, v in outputs.items()})
        for i, (t0, steps) in enumerate(zip(runs.t0, runs.steps.tolist(), strict=True))
    ]


def write_simulation(path: Path, program: Program, runs: Sequence[Simulation]) -> Path:
    """Writes one row a step: file, row, time, outputs, and `<output>.log` where it was measured."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    logged = sorted({name for run in runs for name in run.logged})
    labels = {out.name: _labels(program, out) for out in program.outputs}
    header = [label for out in program.outputs for label in labels[out.name]]
    header += [f"{label}.log" for name in logged for label in labels[name]]
    writer.writerow(["file", "row", *(["time"] if program.sample_time else []), *header])
    for run in runs:
        steps = len(next(iter(run.outputs.values())))
        columns = [run.outputs[out.name].reshape(steps, -1) for out in program.outputs]
        columns += [
            run.logged.get(name, np.full(run.outputs[name].shape, np.nan)).reshape(steps, -1)
            for name in logged
        ]
        table = np.concatenate(columns, axis=1)
        for k in range(steps):
            row = run.first + k
            time = [repr(row * program.sample_time)] if program.sample_time else []
            cells = ["" if np.isnan(cell) else repr(float(cell)) for cell in table[k]]
            writer.writerow([run.record.file, run.record.file_row(row), *time, *cells])
    return write_text(path, text.getvalue())


def _simulation(
    program: Program, data: Dataset, t0: int, outputs: Mapping[str, FloatArray]
) -> Simulation:
    record = next(record for record in data.records if record.start <= t0 < record.stop)
    logged: dict[str, FloatArray] = {}
    for out in program.outputs:
        if out.predicts is not None and out.predicts.signal in data.series:
            series = data.series[out.predicts.signal]
            steps = len(outputs[out.name])
            values = np.full((steps, *series.shape[1:]), np.nan)
            first = t0 + out.predicts.ahead
            last = min(first + steps, record.stop)
            values[: last - first] = series[first:last]
            logged[out.name] = values
    return Simulation(record, t0 - record.start, outputs, logged)


def _labels(program: Program, output: Output) -> list[str]:
    """Names of an output's columns: `q_next`, or `q_next[joint1]` for elements."""
    dimensions = {dimension.name: dimension.labels for dimension in program.dimensions}
    axes = program.step[output.node].type.axes
    if not axes:
        return [output.name]
    names = [dimensions.get(axis.name) or tuple(map(str, range(axis.size))) for axis in axes]
    return [f"{output.name}[{','.join(index)}]" for index in product(*names)]
