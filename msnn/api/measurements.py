"""Checks data, evaluates a model on data, simulates it, and shows the results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from compiler.ir.program import Program
from compiler.passes.close_loop import LoopError
from msnn.api.results import Shown
from msnn.data.dataset import FloatArray
from msnn.errors.failures import MissingExtraError
from msnn.model.model import Model
from msnn.model.model_data import data_folder, known_in, measured, sources_of, told_where_they_were
from msnn.model.weights.weights_file import Weights
from msnn.reports.simulation_plots import plot_simulation, plot_validation
from msnn.simulation.simulate import Simulations, run_record, simulation_rows
from msnn.tables import Table, count
from msnn.validation.measurement import METRICS, UNIT_METRICS
from msnn.validation.reports.report import limits, measurements_cells, metrics_cells
from msnn.validation.reports.words import rollout_text, unit_text
from msnn.validation.validate import ValidationReport
from spec_schema.diagnostics.diagnostic import SpecError

if TYPE_CHECKING:
    from msnn.data.dataset import Dataset
    from msnn.data.reading.frames import Frames
    from msnn.features.data_check.found import DataCheck
    from msnn.simulation.engines.engine import Engine, RolloutProgress
    from msnn.simulation.intervals import Intervals
    from msnn.simulation.simulation_data import GivenData
    from msnn.validation.reports.report import EnginesReport


NOT_HERE = {"E1042", "E1301"}
"""Codes for engines that are not available on this machine, or for this spec."""


def check_data(
    model: Model, data: GivenData | None = None, *, data_root: str | Path | None = None
) -> DataCheck:
    """Checks data before a model is trained on them: sampling, columns, delays, excitation.

        found = msnn.check_data(msnn.load("plant.msnn.yaml"))
        for finding in found.findings:
            print(finding.code, finding.message, finding.help)

    `data` are frames as in `train`, or files with the columns named in the spec; None means the
    data of the spec. The result has the contents of `msnn data --json`. Raises SpecError if data
    cannot be read at all, and MissingExtraError.
    """
    from msnn.features.data_check.check import check_data as run

    return run(model, data, data_root)


def validate(
    model: Model,
    weights: Weights | None = None,
    data: Frames | None = None,
    *,
    data_root: str | Path | None = None,
    engine: str = "auto",
    progress: RolloutProgress | None = None,
    intervals: bool = False,
) -> ShownReport:
    """Evaluates the `validate` section of a spec in float64; weights None: initial weights.

        report = msnn.validate(model, result.weights)
        assert report.passed
        report.to_frame()  # report.plot(); a notebook shows the tables

    `data` is as in `train`; entries with `files:` always use these files. `engine` selects the
    simulation: `interpreter`, the reference; `native` kernels; `torch`; an export (`onnx`,
    `casadi`, `c`, `fmu`); or `auto`, kernels if they save time. `progress(done, total)` receives
    the number of completed steps. `intervals` measures the coverage of prediction intervals;
    weights are then a result or the path of a run. Raises SpecError.
    """
    dataset = None
    # intervals are counted on the data of the spec, whatever the entries read
    if intervals or needs_data(model):
        dataset = measured(model, data, data_root, "validation")
    return validate_on(
        model,
        dataset,
        weights,
        data_root=data_root,
        engine=engine,
        progress=progress,
        intervals=intervals,
    )


def needs_data(model: Model) -> bool:
    """True if an entry is evaluated on the data of the spec instead of its own files."""
    checks = model.spec.checks
    # a spec without entries is measured by one of its own, on these data
    return not checks or any(check.files is None for check in checks)


def validate_on(
    model: Model,
    dataset: Dataset | None,
    weights: Weights | None,
    *,
    data_root: str | Path | None = None,
    engine: str = "auto",
    progress: RolloutProgress | None = None,
    intervals: bool = False,
) -> ShownReport:
    """See `validate`; `dataset` is already loaded, or None if every entry has its own files."""
    from msnn.data.reading.file_sets import load_file_sets
    from msnn.exports.running.exported_rollouts import chosen_engine
    from msnn.model.trained_model import fold_of_another_run
    from msnn.model.weights.covariance import known_covariance
    from msnn.model.weights.kept_starts import known_starts
    from msnn.simulation.engines.engine import nobody
    from msnn.validation import validate as validation

    chosen, checks = chosen_engine(model, engine), model.spec.checks
    known = known_in(model, weights)
    with sources_of(model):
        with told_where_they_were(model, data_root):
            folder = data_folder(model, data_root)
            files = load_file_sets(model.program, model.spec, folder, model.recorded)
        report = validation.validate(
            model.program,
            dataset,
            checks,
            known,
            files=files,
            engine=chosen,
            progress=progress or nobody,
            covariance=known_covariance(weights, known) if intervals else None,
            stages=model.spec.train,
            kept=known_starts(weights, known),
        )
        read = [*([] if dataset is None else [dataset]), *files.values()]
        warnings = [warning for one in read for warning in one.warnings]
        held = fold_of_another_run(model, weights, {found.data for found in report.measurements})
        said = (*warnings, *held, *report.warnings)
        return ShownReport(report.rows, report.measurements, said)


def validate_every_engine(
    model: Model,
    weights: Weights | None = None,
    data: Frames | None = None,
    *,
    data_root: str | Path | None = None,
    progress: RolloutProgress | None = None,
) -> EnginesReport:
    """Evaluates the `validate` section like `validate`, once with every available engine, exports
    too.

    Raises SpecError for errors in the spec or its data.
    """
    from msnn.simulation.engines.open_rollouts import AUTO, ENGINES
    from msnn.validation.reports.report import EnginesReport

    reports: dict[str, ShownReport] = {}
    left_out: dict[str, str] = {}
    names = [engine for engine in ENGINES if engine != AUTO]
    for place, engine in enumerate(names):

        def told(done: int, total: int, place: int = place) -> None:
            if progress is not None:
                progress(place * total + done, len(names) * total)

        try:
            reports[engine] = validate(
                model, weights, data, data_root=data_root, engine=engine, progress=told
            )
        except MissingExtraError as error:
            left_out[engine] = str(error)
        except SpecError as error:
            if not {found.code for found in error.diagnostics} <= NOT_HERE:
                raise
            left_out[engine] = error.diagnostics[0].message
    return EnginesReport(reports, left_out)


def simulate(
    model: Model,
    data: GivenData | None = None,
    weights: Weights | None = None,
    *,
    horizon: int | Literal["record"] | None = None,
    data_root: str | Path | None = None,
    data_set: str | None = None,
    engine: str = "auto",
    progress: RolloutProgress | None = None,
    intervals: float | None = None,
) -> ShownSimulations:
    """Simulates the model over recordings; every input that an output predicts is fed back.

        (run,) = msnn.simulate(model, {"F": force, "x": position}, result.weights)
        print(run.outputs["x_next"], run.logged["x_next"], run.places.rows)

    `data` are frames as in `train`, or files with the columns named in the spec; None means the
    data of the spec. `data_set` selects one set; for files it names the set of the spec that has
    their columns. `horizon` limits the steps of each run; "record" means whole recordings. `engine`
    and `progress` are as in `validate`.

    `intervals=95` adds half the width of 95 % prediction intervals, `run.bands`. They use the
    errors in the set `train` of frames, `{"train": a, "test": b}`, else of the spec; weights are
    then a result or the path of a run. Returns a sequence of runs, with `warnings`, `to_frame()`
    and `plot()`. Raises SpecError, and ValueError for an invalid horizon.
    """
    from msnn.exports.prepare import loop_fault
    from msnn.exports.running.exported_rollouts import chosen_engine
    from msnn.model.weights.kept_starts import known_starts
    from msnn.simulation.engines.engine import nobody
    from msnn.simulation.simulate import simulate as run
    from msnn.simulation.simulate import simulation_program
    from msnn.simulation.simulation_data import simulation_data

    steps = _steps(horizon)
    chosen = chosen_engine(model, engine)
    try:
        program = simulation_program(model.program)
    except LoopError as error:
        raise SpecError([loop_fault(error, None)], model.sources) from None
    dataset = simulation_data(model, program, data, data_root, data_set)
    known = known_in(model, weights)
    bands = None
    if intervals is not None:
        bands = _intervals(model, data, weights, known, intervals / 100.0, data_root, chosen)
    with sources_of(model):
        found = run(
            program,
            dataset,
            known,
            steps,
            data_set,
            engine=chosen,
            progress=progress or nobody,
            intervals=bands,
            kept=known_starts(weights, known),
        )
    return ShownSimulations(found.runs, found.warnings, program)


def _steps(horizon: object) -> int | None:
    """The maximum number of steps of each simulated run; None for whole recordings.

    `horizon` is None, "record" or a positive integer; ValueError otherwise.
    """
    if horizon is None or horizon == "record":
        return None
    if not isinstance(horizon, bool) and isinstance(horizon, Integral) and int(horizon) > 0:
        return int(horizon)
    message = f'`horizon` is "record" or a number of steps, 1 or more, not {horizon!r}'
    raise ValueError(message)


def _intervals(
    model: Model,
    data: GivenData | None,
    weights: Weights | None,
    known: Mapping[str, FloatArray],
    level: float,
    data_root: str | Path | None,
    engine: Engine,
) -> Intervals:
    """The prediction intervals of simulations, from the residuals on the training rows."""
    from msnn.data.reading.frames import with_training_rows
    from msnn.errors.learning.weights import no_training_rows
    from msnn.model.weights.covariance import known_covariance
    from msnn.validation.covered import free_intervals

    if not 0.0 < level < 1.0:
        message = f"intervals hold more than 0 and less than 100 percent, not {100.0 * level:g}"
        raise ValueError(message)
    with sources_of(model):
        covariance = known_covariance(weights, known)
        frames = with_training_rows(data)
        if frames is None and model.spec.data is None:
            why = "the spec has no `data:` section, and no frames are called `train`"
            raise SpecError([no_training_rows(None, why)])
        trained_on = measured(model, frames, data_root, "prediction intervals")
        return free_intervals(model.program, trained_on, known, covariance, level, engine)


@dataclass(frozen=True, slots=True, repr=False)
class ShownReport(Shown, ValidationReport):
    """A validation with its tables; `to_frame` has one row per output, simulation and metric."""

    def _said(self) -> str:
        broken = sum(1 for row in self.rows if row.passed is False)
        limited = sum(1 for row in self.rows if row.passed is not None)
        kept = f"{broken} of {count(limited, 'limit')} not kept" if limited else "no limits"
        return f"ValidationReport: {count(len(self.measurements), 'measurement')}, {kept}"

    def _tables(self) -> Sequence[Table]:
        return [metrics_cells(self), measurements_cells(self)]

    def _columns(self) -> Mapping[str, Sequence[object]]:
        limit = {
            (row.of, row.metric, rollout_text(row), row.data): limits(row) for row in self.rows
        }
        found = [
            (
                each.of,
                metric,
                each.metrics[metric].value,
                unit_text(each.unit) if metric in UNIT_METRICS else "",
                limit.get((each.of, metric, rollout_text(each), each.data), ""),
                rollout_text(each),
                each.data,
                each.scored,
            )
            for each in self.measurements
            for metric in METRICS
        ]
        found += [
            (
                row.of,
                row.metric,
                row.value,
                unit_text(row.unit),
                limits(row),
                rollout_text(row),
                row.data,
                row.scored,
            )
            for row in self.rows
            if row.metric not in METRICS
        ]
        names = ("of", "metric", "value", "unit", "limit", "rollout", "data", "scored")
        return {name: [row[i] for row in found] for i, name in enumerate(names)}

    def _draw(self, path: Path) -> Path:
        return plot_validation(path, self)


@dataclass(frozen=True, slots=True, repr=False)
class ShownSimulations(Shown, Simulations):
    """Simulations; `to_frame` is the table of `msnn simulate`, one row per step."""

    program: Program | None = None
    """The simulated program."""

    def _said(self) -> str:
        steps = sum(run.steps for run in self.runs)
        return f"Simulations: {count(len(self.runs), 'run')}, {count(steps, 'step')}"

    def _ran(self) -> Program:
        assert self.program is not None, "simulate gives it"
        return self.program

    def _tables(self) -> Sequence[Table]:
        rows = [
            (
                ", ".join(dict.fromkeys(run.places.files)),
                ", ".join(name or "no set" for name in dict.fromkeys(run.places.sets)),
                str(run.steps),
                _ends(run_record(run)["rows"]),
                _ends(run_record(run)["time"]),
            )
            for run in self.runs
        ]
        return [Table(("file", "set", "steps", "rows", "time / s"), rows, [2])]

    def _columns(self) -> Mapping[str, Sequence[object]]:
        header, rows = simulation_rows(self._ran(), self.runs)
        columns = list(zip(*rows, strict=True)) or [() for _ in header]
        return {
            # "" is what a file has where there is no number
            name: list(column) if name in ("file", "set") else [_number(cell) for cell in column]
            for name, column in zip(header, columns, strict=True)
        }

    def _draw(self, path: Path) -> Path:
        return plot_simulation(path, self._ran(), self.runs)


def _number(cell: object) -> object:
    return None if cell == "" else cell


def _ends(found: object) -> str:
    if not isinstance(found, list):
        return ""
    ends = cast("list[float | None]", found)
    return " … ".join("–" if end is None else f"{end:g}" for end in ends)
