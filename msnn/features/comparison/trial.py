"""One training of a comparison: a variant, seed and fold is trained, evaluated and costed."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from msnn.data.dataset import Dataset, FloatArray
from msnn.data.reading.frames import Frames
from msnn.errors.failures import MissingExtraError
from msnn.exports.export import plan_exports, write_export
from msnn.features.comparison.errors import killed_again, nothing_held_out
from msnn.features.comparison.readings import Readings
from msnn.features.comparison.variants import Variant
from msnn.model.load import load_model, with_seed
from msnn.model.model import Model
from msnn.model.model_data import sources_of
from msnn.model.model_weights import redrawn_weights
from msnn.model.saved_run import CHECKPOINT, WEIGHTS
from msnn.model.weights.weights_file import read_weights
from msnn.training.folds import fold_count
from msnn.training.plans.stage_data import TRAIN
from msnn.training.records.progress import Silent
from msnn.training.records.run_folder import alone
from msnn.training.records.run_log import LOG, Cost, Measured, RunLine, append, measured_in, read
from msnn.training.records.training_options import in_folder, options_for
from msnn.training.train import train
from msnn.training.training_result import TrainingDivergedError, begun, diverged, ended
from msnn.validation.measurement import METRICS
from msnn.validation.plan import CheckPlan, plan_checks
from msnn.validation.reports.words import rollout_text, unit_text
from msnn.validation.validate import validate
from msnn.verification.exported_c import read_exported_c
from msnn.verification.proof_step import ARM_GCC, ARM_QEMU, GCC, Tool
from msnn.verification.qemu import board_checks
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError, describe
from spec_schema.diagnostics.render import render

_FOLDER = "compare"
_KEY_SHOWN = 16


@dataclass(frozen=True, slots=True)
class Trial:
    """One training: a variant, a fold and a seed."""

    variant: Variant
    seed: int
    """0 means the spec's seed; other seeds draw initial values and batch orders."""
    fold: int | None
    is_costed: bool = True
    """True if its C code is measured; other seeds and folds have the same operations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """The settings that all trials of a comparison share."""

    data: Frames | None
    data_root: Path | None
    held_out: str
    """The set for the comparison."""
    runs: Path | None
    """The folder of runs; None saves nothing."""
    counts_cost: bool


@dataclass(frozen=True, slots=True)
class TrialOutcome:
    """The result of a trial: its line in `runs.jsonl`, and `is_new` if it was trained now."""

    line: RunLine
    is_new: bool
    """False if it was taken from the log."""
    is_logged: bool = False
    """True if the log already contains its line."""


@dataclass(frozen=True, slots=True)
class ReadyTrial:
    """A trial ready for training: its log line, model and data."""

    trial: Trial
    line: RunLine
    model: Model
    data: Dataset


def run_trial(
    trial: Trial, setup: Setup, known: Mapping[str, RunLine], readings: Readings
) -> TrialOutcome:
    """Trains, evaluates and costs a variant, or uses the line in `known`, logged lines by key.

    Errors of the spec or the data, missing packages and divergence are outcomes, not exceptions. If
    another process trains in the same folder, waits for it. Raises TrainingInterruptedError.
    """
    found = ready_trial(trial, setup, known, readings)
    if isinstance(found, TrialOutcome):
        return found
    if setup.runs is None:
        return train_ready(found, setup)
    folder = setup.runs / trial_folder(found.model, found.line)
    with alone(folder):
        # another comparison has trained it since the log was read, or a process was killed here
        if folder.exists():
            of_now = {line.key: line for line in read(setup.runs / LOG)}
            found = ready_trial(trial, setup, of_now, readings)
            if isinstance(found, TrialOutcome):
                return replace(found, is_logged=found.line == of_now.get(found.line.key))
        outcome = train_ready(found, setup)
        # before another process may look
        is_logged = log_outcome(setup.runs / LOG, outcome.line)
        return replace(outcome, is_logged=is_logged)


def log_outcome(log: Path, line: RunLine) -> bool:
    """Appends the line of a completed training to the log and removes its checkpoint. Returns
    False, and writes nothing, for a refused trial, which can be tried again.
    """
    # a refused spec can be mended: next time it is tried again
    if line.state == "refused":
        return False
    append(log, line)
    # after the line: killed between the two, the training is in the log and its checkpoint
    # harmless; until then a killed comparison goes on from it
    if line.folder is not None:
        (log.parent / line.folder / CHECKPOINT).unlink(missing_ok=True)
    return True


def ready_trial(
    trial: Trial, setup: Setup, known: Mapping[str, RunLine], readings: Readings
) -> ReadyTrial | TrialOutcome:
    """Loads model and data of a trial. Returns its outcome instead if `known`, the logged lines by
    key, has it, or if spec or data have errors or a package is missing.
    """
    # a spec that cannot be read has no hash; its line says at least which one was tried
    line = _unknown(trial)
    try:
        model = with_seed(readings.model(trial.variant, trial.fold), trial.seed)
        data = readings.data(trial.variant, trial.fold)
        # before training: what cannot be compared need not be trained
        _require_rows(data, setup.held_out)
        line = begun(model, data, seed=trial.seed, fold=trial.fold, held_out=setup.held_out)
        line = replace(line, drawn_by=trial.variant.drawn_by)
        ready = ReadyTrial(trial, line, model, data)
        if line.key in known and _is_kept(known[line.key], model, setup):
            return TrialOutcome(_completed(known[line.key], ready, setup), is_new=False)
    except (SpecError, MissingExtraError) as error:
        return refused(line, error)
    return ready


def train_ready(ready: ReadyTrial, setup: Setup) -> TrialOutcome:
    """Trains, evaluates and costs a trial. Errors of spec and data, missing packages and divergence
    are outcomes. Raises TrainingInterruptedError.
    """
    try:
        with sources_of(ready.model):
            return TrialOutcome(_trained(ready, setup), is_new=True)
    except (SpecError, MissingExtraError) as error:
        return refused(ready.line, error)
    # an outcome and no end: in a sweep some learning rates always are too high
    except TrainingDivergedError as error:
        return TrialOutcome(diverged(ready.line, error), is_new=True)


def trial_folder(model: Model, line: RunLine) -> Path:
    """The folder of a trial's run, relative to the folder of runs; it contains the key of `line`,
    so that a killed training finds its checkpoint.
    """
    # by its key, no time: a training that was killed finds its checkpoint there
    return Path(model.name) / _FOLDER / line.key[:_KEY_SHOWN]


def killed(trial: Trial, times: str) -> TrialOutcome:
    """The outcome of a trial whose process was killed repeatedly, with E0977 as reason; `times`
    says how often, such as `twice`.
    """
    return refused(_unknown(trial), SpecError((killed_again(trial.variant.label, times),)))


def refused(line: RunLine, error: SpecError | MissingExtraError) -> TrialOutcome:
    """The outcome of a trial that cannot be trained: `line` with the state `refused` and the text
    of the error as reason.
    """
    found = error.diagnostics if isinstance(error, SpecError) else [error.diagnostic]
    sources = error.sources if isinstance(error, SpecError) else ()
    reason = render(found, "full", sources)
    return TrialOutcome(replace(line, state="refused", reason=reason), is_new=True)


def _is_kept(line: RunLine, model: Model, setup: Setup) -> bool:
    """True if the logged training `line` can be used instead of a new one: it has the measurements
    that `model` requests and, if runs are saved, valid weights. Failed trainings are always used.

    A weights file that is missing, empty, truncated or has other arrays is invalid.
    """
    if line.state != "finished":
        return True
    # a log of before told fewer ways to measure apart
    if {each.way for each in line.held_out} != {each.way for each in planned(model)}:
        return False
    if setup.runs is None:
        return True
    if line.folder is None:
        return False
    try:
        read_weights(setup.runs / line.folder / WEIGHTS, model.program)
    except SpecError:
        return False
    return True


def _require_rows(data: Dataset, held_out: str) -> None:
    if not data.has(held_out):
        raise SpecError((nothing_held_out(held_out, data.sets),))


def _unknown(trial: Trial) -> RunLine:
    """The line of `runs.jsonl` for a trial whose spec is not read: `refused`, no key, no hashes."""
    return RunLine(
        key="",
        model=trial.variant.label,
        spec=str(trial.variant.spec),
        spec_sha256="",
        settings=trial.variant.settings,
        seed=trial.seed,
        fold=trial.fold,
        data_sha256="",
        state="refused",
        reason="",
    )


def _completed(line: RunLine, ready: ReadyTrial, setup: Setup) -> RunLine:
    """A logged line, with its cost and the metrics on training rows added if they are missing and
    its weights are saved.

    A training by another command may lack both: `train --folds` only evaluates the held-out fold.
    """
    model, data = ready.model, ready.data
    lacks_cost = setup.counts_cost and ready.trial.is_costed and line.cost is None
    if (line.training and not lacks_cost) or setup.runs is None or line.folder is None:
        return line
    weights = read_weights(setup.runs / line.folder / WEIGHTS, model.program)
    if not line.training:
        # what the spec asks for, on the training rows: information criteria are of these
        line = replace(line, training=_measured(model, data, weights, TRAIN))
    return replace(line, cost=c_cost(model, weights)) if lacks_cost else line


def _trained(ready: ReadyTrial, setup: Setup) -> RunLine:
    trial, line, model, data = ready.trial, ready.line, ready.model, ready.data
    first = redrawn_weights(model, trial.seed) if trial.seed else None
    heard = _Heard()
    # standard errors take as long as some epochs, and no table shows them
    options = options_for(model, runs=setup.runs, has_errors=False)
    if setup.runs is not None:
        options = in_folder(options, setup.runs / trial_folder(model, line))
        options = replace(options, ends_in_log=True)
    found = train(model.program, data, model.spec.train, options, heard, first)
    weights = found.weights
    return replace(
        ended(line, found, setup.runs),
        held_out=_measured(model, data, weights, setup.held_out),
        training=_measured(model, data, weights, TRAIN),
        cost=c_cost(model, weights) if setup.counts_cost and trial.is_costed else None,
        warnings=tuple(heard.said),
    )


def _measured(
    model: Model, data: Dataset, weights: Mapping[str, FloatArray], name: str
) -> tuple[Measured, ...]:
    """The metrics of the spec's `validate` section, evaluated on the rows of the set `name`."""
    checks, stages = model.spec.checks, model.spec.train
    found = validate(
        model.program, data, checks, weights, on=name, judges_errors=False, stages=stages
    )
    return measured_in(found)


class _Heard(Silent):
    """Collects the warnings of a training."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def warned(self, diagnostic: Diagnostic) -> None:
        self.said.append(describe(diagnostic))


@dataclass(slots=True)
class TrialLists:
    """Lists the trials of variants: one for each of `seeds` seeds, and with `folds` for each fold
    of the spec's split.
    """

    seeds: int
    folds: bool
    _counts: dict[tuple[object, ...], int] = field(
        init=False, default_factory=dict[tuple[object, ...], int]
    )

    def of(self, compared: Sequence[Variant]) -> list[Trial]:
        """The trials of all variants with the first seed, then with the next. Raises SpecError if a
        spec cannot be read or has no folds.
        """
        return [
            Trial(variant, seed, fold, is_costed=seed == 0 and fold in (None, 1))
            # a comparison that is interrupted has every variant by one seed, not one variant by all
            for seed in range(self.seeds)
            for variant in compared
            for fold in self._folds(variant)
        ]

    def _folds(self, variant: Variant) -> Sequence[int | None]:
        if not self.folds:
            return (None,)
        # folds are counted by reading files: once for all variants that read the same
        of_data = (setting for setting in variant.settings if setting.startswith("data"))
        key = (variant.spec, *of_data)
        if key not in self._counts:
            self._counts[key] = fold_count(load_model(variant.spec, variant.settings))
        return range(1, self._counts[key] + 1)


def planned(model: Model) -> tuple[Measured, ...]:
    """The metrics of the `validate` section before any training, with NaN as values. Raises
    SpecError for errors in that section.
    """
    findings = Findings()
    plans = plan_checks(model.program, model.spec.checks, findings)
    findings.raise_errors()
    return tuple(_planned(plan) for plan in plans)


@dataclass(frozen=True, slots=True)
class _Simulated:
    horizon: str
    closed: tuple[str, ...]
    details: tuple[str, ...]


def _planned(plan: CheckPlan) -> Measured:
    names: tuple[str, ...] = ("loss",) if plan.metric is None else METRICS
    how = _Simulated(str(plan.rollout.horizon), plan.rollout.closed, plan.details)
    return Measured(
        of=plan.of,
        unit=unit_text(plan.unit),
        rollout=rollout_text(how),
        scored=0,
        asked="loss" if plan.metric is None else plan.metric,
        # what will be known is which numbers there are: criteria are looked up by name
        metrics=dict.fromkeys(names, math.nan),
    )


# the commonest core with single precision in hardware
_BOARD = frozenset({"m4"})
_NEEDS = (ARM_GCC, ARM_QEMU, GCC)


def missing_tools() -> tuple[Tool, ...]:
    """The missing tools for counting instructions."""
    return tuple(tool for tool in _NEEDS if not tool.is_there)


def c_cost(model: Model, weights: Mapping[str, FloatArray]) -> Cost | None:
    """The cost of the exported C code on an emulated Cortex-M4F (QEMU), at -O2.

    The code is that of `msnn export --to c`, measured over its golden steps. None if a tool is
    missing, or if the model cannot be exported to C.
    """
    if missing_tools():
        return None
    findings = Findings()
    plans = plan_exports(model, ("c",), findings, weights=weights)
    if findings.failed or not plans:
        return None
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "c"
        try:
            write_export(plans[0], weights, folder)
            check = next(iter(board_checks(read_exported_c(folder), _BOARD)))
        except SpecError:  # what C cannot hold is the business of `export`
            return None
        result = check.result(Path(place) / "build")
    if not result.figures:
        return None
    (figures,) = result.figures
    _, mean, _ = figures.instructions
    ram = figures.data + figures.bss
    return Cost(f"{result.target}", mean, figures.flash, ram)
