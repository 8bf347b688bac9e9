"""Trains a program: stages in their order, each from the best weights of the one before (R12)."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.errors import stages as stage_errors
from msnn.errors import training as errors
from msnn.errors import weights as weight_errors
from msnn.model.weights_file import initial_weights
from msnn.training.divergence import explain_divergence
from msnn.training.engines.devices import on_device
from msnn.training.engines.engine import Engine, NonFiniteLossError
from msnn.training.engines.open_engine import open_engine, try_optimizers
from msnn.training.multi_start import StageAttempts
from msnn.training.parameter_warnings import parameter_warnings
from msnn.training.plans.stage_data import StageData, stage_data
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from msnn.training.plans.stage_result import StageResult
from msnn.training.records.checkpoint import Checkpoint, write_checkpoint
from msnn.training.records.interrupts import end_on_interrupt
from msnn.training.records.parameters_record import parameters_record
from msnn.training.records.progress import EpochEnd, Progress, Silent, StageEnd, StageStart
from msnn.training.records.resumable_run import NotedProgress, open_run
from msnn.training.records.run_folder import RunFolder
from msnn.training.records.run_record import run_record
from msnn.training.records.standard_errors import StandardErrors, standard_errors
from msnn.training.records.tensorboard_curves import Curves, require_tensorboard
from msnn.training.records.training_options import TrainingOptions
from msnn.training.stage_run import Interrupted, StageRun
from msnn.training.starts.initial_weights_of_run import first_weights
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.sections.training.training import Stage


@dataclass(frozen=True, slots=True)
class TrainingResult:
    """Trained weights in physical units, what each stage reached, and where the run is kept."""

    weights: Mapping[str, FloatArray]
    stages: tuple[StageResult, ...]
    folder: Path | None
    warnings: tuple[Diagnostic, ...]
    standard_errors: StandardErrors | None = None
    """Of a run that is kept in a folder and came to its end."""


class TrainingDivergedError(Exception):
    """A stage met a value that is not finite; the best weights so far are in `result`.

    `latest` leads to them where the run had been interrupted before, and only there.
    """

    def __init__(self, diagnostic: Diagnostic, result: TrainingResult, *, is_latest: bool) -> None:
        super().__init__(diagnostic.message)
        self.diagnostic = diagnostic
        self.is_latest = is_latest
        self.result = result


class TrainingInterruptedError(Exception):
    """The user ended the run; `result` has the best weights so far, `resume` goes on."""

    def __init__(self, result: TrainingResult) -> None:
        super().__init__("training was interrupted; it can be resumed")
        self.result = result


def train(
    program: Program,
    data: Dataset,
    stages: Sequence[Stage],
    options: TrainingOptions | None = None,
    progress: Progress | None = None,
    weights: Mapping[str, FloatArray] | None = None,
) -> TrainingResult:
    """Trains the stages one after the other and returns the best weights of the last.

    `program` is in window form. `weights` are where the first stage begins, by default the initial
    values. Raises SpecError before anything runs when stages and data do not fit,
    TrainingDivergedError, TrainingInterruptedError and MissingExtraError.
    """
    options, progress = options or TrainingOptions(), progress or Silent()
    if options.tensorboard:
        require_tensorboard()
    findings = Findings()
    plans = on_device(plan_stages(program, stages, findings), options.device, findings)
    datas = [stage_data(plan, data, findings) for plan in plans]
    findings.raise_errors()
    try_optimizers(program, plans)
    ready = [(p, d) for p, d in zip(plans, datas, strict=True) if d is not None]
    first = dict(first_weights(program, data) if weights is None else weights)
    record = run_record(program, plans, data, options.parts)
    folder, checkpoint = open_run(program, options, record)
    noted = NotedProgress(progress, folder)
    for warning in (*data.warnings, *findings.in_order):
        noted.warned(warning)
    curves = Curves(folder.path) if folder is not None and options.tensorboard else None
    run = _Run(program, data, ready, folder, curves, noted, findings.in_order, options.redrawn)
    try:
        with end_on_interrupt() as stop_asked:
            return run.through(first, checkpoint, stop_asked)
    finally:
        if curves is not None:
            curves.close()


@dataclass(slots=True)
class _Run:
    program: Program
    data: Dataset
    stages: Sequence[tuple[StagePlan, StageData]]
    folder: RunFolder | None
    curves: Curves | None
    progress: NotedProgress
    warnings: tuple[Diagnostic, ...]
    redrawn: Callable[[int], Mapping[str, FloatArray]] | None

    def through(
        self,
        weights: dict[str, FloatArray],
        checkpoint: Checkpoint | None,
        stop_asked: threading.Event,
    ) -> TrainingResult:
        done: list[StageResult] = []
        for plan, data in self.stages:
            if checkpoint is not None and plan.index < checkpoint.stage:
                continue
            stage = self._attempts(plan, data, weights, stop_asked)
            if checkpoint is not None and plan.index == checkpoint.stage:
                stage.resume(checkpoint)
            self._announce(plan, data)
            self._warn_of_same_starts(plan, weights)
            try:
                result = stage.run()
            except Interrupted as event:
                self._keep(stage.best or weights)
                if self.folder is not None and self.folder.latest is not None:
                    write_checkpoint(self.folder.checkpoint, event.checkpoint)
                    self.folder.become_latest()
                self.progress.run_ended("interrupted")
                found = self._result(stage.best or weights, done)
                raise TrainingInterruptedError(found) from None
            except NonFiniteLossError as fault:
                self._keep(stage.best or weights)
                diagnostic = self._explained(stage.current, fault)
                self.progress.run_ended("diverged", [diagnostic])
                found = self._result(stage.best or weights, done)
                latest = self.folder is not None and self.folder.is_latest
                raise TrainingDivergedError(diagnostic, found, is_latest=latest) from None
            done.append(result)
            weights = dict(result.best)
            self._keep(weights)
            self.progress.stage_ended(_stage_end(plan, result))
        if self.folder is None:
            return self._result(weights, done)
        self.folder.checkpoint.unlink(missing_ok=True)
        self.folder.become_latest()
        errors = standard_errors(self.stages[-1][0], self.data, weights)
        self.folder.write_parameters(parameters_record(self.program, weights, errors))
        self.progress.run_ended("finished", parameter_warnings(self.program, weights, errors))
        return replace(self._result(weights, done), standard_errors=errors)

    def _attempts(
        self,
        plan: StagePlan,
        data: StageData,
        weights: Mapping[str, FloatArray],
        stop_asked: threading.Event,
    ) -> StageAttempts:
        def opened(attempt: int) -> StageRun:
            begin = self._begin(plan, weights, attempt)
            opened = open_engine(plan, self.data.series, begin, data)
            engine = opened.engine
            for note in opened.notes if attempt == 0 else ():
                self.progress.warned(note)
            if engine.moved:
                self.progress.warned(weight_errors.moved_off_bound(engine.moved))
            return StageRun(
                plan,
                engine,
                data,
                self.program.spec_hash,
                stop_asked.is_set,
                lambda event: self._epoch_ended(event, engine),
                attempt,
            )

        return StageAttempts(plan, opened, self._left_out)

    def _begin(
        self, plan: StagePlan, weights: Mapping[str, FloatArray], attempt: int
    ) -> Mapping[str, FloatArray]:
        """Where an attempt begins: trained parameters at their initial values are drawn again."""
        if attempt == 0 or self.redrawn is None:
            return weights
        initial, drawn = initial_weights(self.program), self.redrawn(attempt)
        return {
            name: drawn[name]
            if name in plan.trained and np.array_equal(value, initial[name])
            else value
            for name, value in weights.items()
        }

    def _warn_of_same_starts(self, plan: StagePlan, weights: Mapping[str, FloatArray]) -> None:
        if plan.attempts == 1 or plan.masks:
            return
        second = self._begin(plan, weights, 1)
        if all(np.array_equal(second[name], weights[name]) for name in plan.trained):
            self.progress.warned(stage_errors.same_starts(plan.name, plan.attempts, plan.span))

    def _left_out(self, attempt: StageRun, fault: NonFiniteLossError) -> None:
        why = self._explained(attempt, fault)
        number = attempt.attempt + 1
        self.progress.warned(errors.attempt_left_out(number, attempt.plan.attempts, why))

    def _explained(self, attempt: StageRun, fault: NonFiniteLossError) -> Diagnostic:
        now, epoch = attempt.engine.weights(), attempt.epoch + 1
        return explain_divergence(attempt.plan, self.data, now, fault.runs, epoch)

    def _announce(self, plan: StagePlan, data: StageData) -> None:
        self.progress.stage_started(
            StageStart(
                number=plan.index + 1,
                stages=len(self.stages),
                name=plan.name,
                epochs=plan.epochs,
                starts=len(data.train),
                horizon=str(plan.rollout.horizon),
                monitored_on=data.watched_set,
                attempts=plan.attempts,
            )
        )

    def _epoch_ended(self, event: EpochEnd, engine: Engine) -> None:
        if self.folder is not None:
            self.folder.append_metrics(asdict(event))
        if self.curves is not None:
            self.curves.epoch_ended(event, engine.weights())
        self.progress.epoch_ended(event)

    def _keep(self, weights: Mapping[str, FloatArray]) -> None:
        if self.folder is not None:
            self.folder.write_weights(weights)

    def _result(
        self, weights: Mapping[str, FloatArray], stages: Sequence[StageResult]
    ) -> TrainingResult:
        path = None if self.folder is None else self.folder.path
        return TrainingResult(weights, tuple(stages), path, self.warnings)


def _stage_end(plan: StagePlan, result: StageResult) -> StageEnd:
    return StageEnd(
        plan.name,
        result.attempt + 1,
        plan.attempts,
        result.epochs,
        result.best_value,
        result.best_epoch,
        result.seconds,
        result.reason,
    )
