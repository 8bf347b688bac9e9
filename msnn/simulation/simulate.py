"""Simulates a program over whole recordings: outputs, their rows in the data, and a table."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import overload

import numpy as np

from backends.files.atomic_write import replacing
from compiler.differentiation.estimated_starts import (
    estimated_states,
    evaluations_that_decide,
    start_signal,
    with_read_starts,
)
from compiler.ir.nodes import extents, states_beside_the_log
from compiler.ir.program import NodeId, Output, Program, Role
from compiler.passes.close_loop import close_loop
from msnn.data.dataset import BETWEEN_ROWS, UNASSIGNED, Dataset, FloatArray, IntArray, Record
from msnn.data.rollout_rows import Runs, reach, reads, rollouts
from msnn.errors.data import rows as data_rows
from msnn.errors.workflow import records_too_short, unknown_set
from msnn.model.weights.kept_starts import KeptStarts
from msnn.simulation.engines.engine import Count, Engine, RolloutProgress, first_places, nobody
from msnn.simulation.engines.open_rollouts import open_rollouts
from msnn.simulation.intervals import Intervals, uncertain_program
from msnn.simulation.rollout_plan import begun_where_known, files_skipped, predicted_inputs
from msnn.simulation.start_fit import StartFit, uncertain_starts
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError


@dataclass(frozen=True, slots=True)
class StepPlaces:
    """Where each step of a simulation is in the data files: file, row and time."""

    files: tuple[str, ...]
    rows: IntArray
    """Row of the file, counted from 0 below the header; BETWEEN_ROWS if it is resampled."""
    time: FloatArray | None
    """Time in seconds as in the file, or counted from its row 0 if it has no time.

    In files joined by their dates, it is counted from row 0 of the first file.
    """
    sets: tuple[str, ...]
    """The set of the row; "" for rows in no set."""

    def along(self, *, timed: bool) -> FloatArray:
        """Times or rows as x-axis of a plot, continuous across files."""
        own = self.time if timed and self.time is not None else self.rows
        found = np.asarray(own, np.float64)
        if len(set(self.files)) < 2:
            return found
        # a run has no gap: its steps are alike
        return found[0] + float(np.median(np.diff(found))) * np.arange(len(found))

    def joins(self, step: int) -> bool:
        """True if the file has a row for a step; false if the step is between two rows by
        resampling.
        """
        return int(self.rows[step]) != BETWEEN_ROWS


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Simulation:
    """A simulation over one interval of a recording without a gap; arrays are (steps, *shape)."""

    record: Record
    first: int
    """Row of the dataset at which the first step was evaluated."""
    outputs: Mapping[str, FloatArray]
    logged: Mapping[str, FloatArray]
    """Measurements of the signal that an output predicts; NaN if missing."""
    inputs: Mapping[str, FloatArray]
    """Values at the row of each step, for every input that is not fed back."""
    places: StepPlaces
    bands: Mapping[str, FloatArray]
    """Half the width of prediction intervals, if requested."""
    starts: Mapping[str, FloatArray]
    """Estimated initial values of states of this run."""

    @property
    def steps(self) -> int:
        return len(self.places.rows)

    def __repr__(self) -> str:
        names = ", ".join(self.outputs)
        return f"<Simulation of {self.record.file}: {self.steps} steps of {names}>"


@dataclass(frozen=True, slots=True)
class Simulations(Sequence[Simulation]):
    """The simulations of one call, in the order of the data, with warnings."""

    runs: tuple[Simulation, ...]
    warnings: tuple[Diagnostic, ...] = ()

    def __len__(self) -> int:
        return len(self.runs)

    @overload
    def __getitem__(self, index: int) -> Simulation: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Simulation]: ...
    def __getitem__(self, index: int | slice) -> Simulation | Sequence[Simulation]:
        return self.runs[index]


def simulation_program(program: Program, close: Iterable[str] | None = None) -> Program:
    """The program that `simulate` runs: loops closed, losses and their targets removed.

    `close` None closes every input that an output predicts. Load the data with this program:
    columns that the run does not read may then be absent. Raises LoopError.
    """
    if close is None:
        close = predicted_inputs(program)
    closed = close_loop(program, tuple(close))
    if estimated_states(closed):  # what the losses compare decides where runs start
        compared = [node for loss in closed.losses for node in loss.nodes]
        return _reading(replace(closed, fits=()), compared)
    following = {state.name: state.next for state in closed.states}
    outputs = [output.node for output in closed.outputs]
    # states that no output feels would be simulated for nothing, and ask for columns
    beside = states_beside_the_log(closed.step, following, outputs)
    kept = tuple(state for state in closed.states if state.name not in beside)
    return _reading(replace(closed, losses=(), fits=(), states=kept), [])


def _reading(program: Program, compared: Iterable[NodeId]) -> Program:
    """The program with only those signals that a run reads."""
    wanted = [output.node for output in program.outputs] + [s.next for s in program.states]
    read = {**reads(program.step, [*wanted, *compared])}
    read |= reads(program.start, [state.start for state in program.states])
    return replace(program, signals=tuple(s for s in program.signals if s.name in read))


def simulate(
    program: Program,
    data: Dataset,
    weights: Mapping[str, FloatArray] | None = None,
    horizon: int | None = None,
    data_set: str | None = None,
    *,
    engine: Engine = "auto",
    progress: RolloutProgress = nobody,
    intervals: Intervals | None = None,
    kept: KeptStarts | None = None,
) -> Simulations:
    """Simulates all intervals of the data, each from its first possible row.

    `program` is in window form; closed signals are fed back, open ones are read from the data.
    `horizon` limits the steps of every run; `data_set` selects the intervals of one set. `engine`
    is as for `open_rollouts` and computes in float64, except for exports. `intervals` defines
    prediction intervals; `kept` are initial states from the training. Raises SpecError if there is
    no such set, all intervals are too short, or the data do not determine the initial state of a
    run.
    """
    # targets of `predicts` need not be there: a simulation may run past the last of them
    unscored = replace(
        program, outputs=tuple(replace(o, predicts=None) for o in program.outputs), losses=()
    )
    far = reach(unscored)
    stretches = _stretches(data, data_set)
    runs = rollouts(stretches, far, "record", 1)
    runs = begun_where_known(unscored, data, runs)
    if not len(runs):
        raise SpecError([records_too_short(runs.longest, far.rows(1))])
    warnings = data.warnings
    if runs.skipped:
        files = files_skipped(data, stretches, runs)
        skipped = (runs.skipped, len(stretches), far.rows(1))
        warnings += (data_rows.episodes_skipped(*skipped, "the simulation", files),)
    # before `horizon` cuts runs: a start is fitted over its first evaluations, however few are
    # asked for
    estimated = estimated_states(program)
    program, series, uncertain = _started(program, data, stretches, runs, weights, kept)
    warnings += tuple(uncertain)
    begun = {state.name: series[start_signal(state.name)][runs.t0] for state in estimated}
    if horizon is not None:
        runs = replace(runs, steps=np.minimum(runs.steps, horizon))
    spread = None if intervals is None else uncertain_program(program, intervals, weights or {})
    ran, known = (program, weights or {}) if spread is None else (spread.program, spread.weights)
    opened = open_rollouts(engine, ran, known, series, runs)
    count = Count(progress, int(runs.steps.sum()))
    outputs = opened.engine.outputs(runs, count.advance)
    bands: Mapping[str, FloatArray] = {}
    if intervals is not None and spread is not None:
        bands = {
            name: intervals.half_width(name, spread.variance(name, outputs))
            for name in intervals.noise
        }
    # a row after a gap was measured at another time than the steps before it predict
    # the first row behind each stretch without gap
    ends = np.append(np.flatnonzero(~data.continues), data.rows)
    unbroken = ends[np.searchsorted(ends, runs.t0, side="right")]
    places = (column.tolist() for column in (runs.t0, runs.steps, first_places(runs), unbroken))
    found = tuple(
        _simulation(
            program,
            data,
            range(t0, t0 + steps),
            {out.name: outputs[out.name][first : first + steps] for out in program.outputs},
            {name: values[first : first + steps] for name, values in bands.items()},
            last,
            {name: values[number] for name, values in begun.items()},
        )
        for number, (t0, steps, first, last) in enumerate(zip(*places, strict=True))
    )
    return Simulations(found, (*warnings, *opened.notes))


def _started(
    program: Program,
    data: Dataset,
    stretches: IntArray,
    runs: Runs,
    weights: Mapping[str, FloatArray] | None,
    kept: KeptStarts | None,
) -> tuple[Program, Mapping[str, FloatArray], Sequence[Diagnostic]]:
    """The program and series with the initial states of runs, and warnings about their
    uncertainty.
    """
    estimated = estimated_states(program)
    if not estimated:
        return program, data.series, ()
    far = reach(program)
    # the end of the stretch that each run is in, wherever the run itself shall end
    stops = stretches[np.searchsorted(stretches[:, 0], runs.t0, side="right") - 1, 1]
    room = np.maximum(stops - far.ahead - runs.t0, 0)
    fit = StartFit(program, evaluations_that_decide(estimated))
    found = fit.find_or_take(data, replace(runs, steps=room), weights, kept=kept)
    series = {**data.series, **found.series(data.rows)}
    warnings = uncertain_starts(found, data, "the simulation")
    if any(one.severity == "error" for one in warnings):
        raise SpecError(warnings)
    # losses decided the starts; the run itself has none
    return with_read_starts(replace(program, losses=())), series, warnings


def _stretches(data: Dataset, data_set: str | None) -> IntArray:
    if data_set is None:
        return data.stretches()
    if data_set not in data.sets:
        raise SpecError([unknown_set(data_set, None, data.sets)])
    if not data.has(data_set):
        known = [known for known in data.sets if data.has(known)]
        raise SpecError([data_rows.no_rows_in_set(data_set, known, None)])
    # of one set its episodes, which end where the set does; of all the stretches, whatever the sets
    return data.episodes(data_set)


def _simulation(
    program: Program,
    data: Dataset,
    rows: range,
    outputs: Mapping[str, FloatArray],
    bands: Mapping[str, FloatArray],
    unbroken: int,
    starts: Mapping[str, FloatArray],
) -> Simulation:
    """One run; measurements come from the rows before `unbroken`."""
    t0, steps = rows.start, len(rows)
    record = data.record_of(t0)
    logged: dict[str, FloatArray] = {}
    for out in program.outputs:
        if out.predicts is not None and out.predicts.signal in data.series:
            series = data.measured_values(out.predicts.signal)
            values = np.full((steps, *series.shape[1:]), np.nan)
            first = t0 + out.predicts.ahead
            # a prediction k samples ahead of the last rows has nothing to be compared with: NaN
            # there
            last = max(min(first + steps, unbroken), first)
            values[: last - first] = series[first:last]
            logged[out.name] = values
    places = _places(program, data, record, rows)
    return Simulation(
        record=record,
        first=t0 - record.start,
        outputs=outputs,
        logged=logged,
        inputs={name: data.series[name][t0 : t0 + steps] for name in _read(program)},
        places=places,
        bands=bands,
        starts=starts,
    )


def _read(program: Program) -> list[str]:
    """The inputs that the steps of a program read."""
    read = extents(program.step, log=False)
    return [s.name for s in program.signals if s.role is Role.INPUT and s.name in read]


def _places(program: Program, data: Dataset, record: Record, rows: range) -> StepPlaces:
    """The places of rows of the series in the files of their recording."""
    first, stop = rows.start, rows.stop
    pieces = [
        (piece, max(first, piece.start), min(stop, piece.stop))
        for piece in record.pieces
        if piece.start < stop and first < piece.stop
    ]
    times = [piece.times(begin, end, program.sample_time) for piece, begin, end in pieces]
    # files are joined by their times: only the one file of a record can be without
    known = [time for time in times if time is not None]
    codes: list[int] = data.set_of_row[first:stop].tolist()
    return StepPlaces(
        files=tuple(piece.file for piece, begin, end in pieces for _ in range(begin, end)),
        rows=np.concatenate([piece.file_rows(begin, end) for piece, begin, end in pieces]),
        time=np.concatenate(known) if known else None,
        sets=tuple("" if code == UNASSIGNED else data.sets[code] for code in codes),
    )


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
    """The columns' names and the rows of the table that `write_simulation` writes; "" is a missing
    value.
    """
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
    """The files, rows and times of the first and last step of a simulation, as a JSON object."""
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
