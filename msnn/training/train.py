"""Trains a program: stages in order, each from the best weights of the previous one (R12)."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.data.rollout_rows import Runs
from msnn.errors.learning import runs
from msnn.errors.learning import runs as run_ends
from msnn.errors.learning import stages as second_order
from msnn.errors.learning import stages as stage_errors
from msnn.errors.learning import training as errors
from msnn.errors.learning import weights as weight_errors
from msnn.training.engines.devices import on_device
from msnn.training.engines.engine import Engine, NonFiniteLossError
from msnn.training.engines.open_engine import open_engine, try_optimizers
from msnn.training.plans.stage_data import StageData, stage_data, with_default_weights
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from msnn.training.plans.stage_result import StageResult
from msnn.training.processes import (
    Reached,
    check_same_engine,
    check_same_training,
    check_same_weights,
    checkpoint_of_first,
)
from msnn.training.ranks.training_ranks import weights_of_first
from msnn.training.records.checkpoint import Checkpoint
from msnn.training.records.curves import Curves, require_tensorboard
from msnn.training.records.learned.information_of_stage import kept_starts
from msnn.training.records.learned.parameters_record import (
    parameter_warnings,
    parameters_record,
    zero_slices,
)
from msnn.training.records.learned.standard_errors import (
    StandardErrors,
    standard_errors,
    without_errors,
)
from msnn.training.records.learned.total_slope import with_bounds
from msnn.training.records.progress import EpochEnd, Progress, Silent, StageStart
from msnn.training.records.resumable_run import (
    NotedProgress,
    Safekeeping,
    end_on_interrupt,
    open_run,
)
from msnn.training.records.run_folder import RunFolder, held
from msnn.training.records.run_record import run_record, stage_end
from msnn.training.records.training_options import TrainingOptions
from msnn.training.stages.divergence import explain_divergence
from msnn.training.stages.stage_course import LateJumps, StageCourse, unmoved
from msnn.training.stages.stage_run import Interrupted, StageAttempts, StageRun
from msnn.training.stages.stage_starts import stage_starts
from msnn.training.starts.data_scales import with_data_scales
from msnn.training.starts.initial_weights import begins_alike, drawn_weights, first_weights
from msnn.training.training_result import (
    TrainingDivergedError,
    TrainingInterruptedError,
    TrainingResult,
)
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.sections.training import Stage


def train(
    program: Program,
    data: Dataset,
    stages: Sequence[Stage],
    options: TrainingOptions | None = None,
    progress: Progress | None = None,
    weights: Mapping[str, FloatArray] | None = None,
) -> TrainingResult:
    """Trains the stages in order, each from the best weights of the previous one.

    `program` is in window form. `weights` are the initial weights of the first stage, by default
    the initial values. Returns the best weights of the last stage. Raises SpecError before training
    if stages and data do not fit, TrainingDivergedError, TrainingInterruptedError and
    MissingExtraError.
    """
    options, progress = options or TrainingOptions(), progress or Silent()
    # first of all: nothing is planned or compiled for a package that is missing
    if options.tensorboard:
        require_tensorboard()
    findings = Findings()
    plans = on_device(plan_stages(program, stages, findings), options.device, findings)
    datas = [stage_data(plan, data, findings) for plan in plans]
    # after the data were looked through: stages and data are told of together
    findings.raise_errors()
    # before the run's folder is made: an optimiser that torch refuses leaves nothing behind
    try_optimizers(program, plans)
    ranks = options.ranks
    # ranks must begin alike: each would draw its own, and train another model
    first = weights_of_first(ranks, first_weights(program, data) if weights is None else weights)
    weighed = with_default_weights([replace(plan, ranks=ranks) for plan in plans], data)
    plans = with_data_scales(weighed, data, first)
    ready = [(p, d) for p, d in zip(plans, datas, strict=True) if d is not None]
    record = run_record(program, plans, data, options.parts)
    # before a folder is made: of ranks that differ none leaves anything behind
    check_same_training(ranks, record)
    folder, checkpoint = open_run(program, options, record)
    checkpoint = checkpoint_of_first(ranks, folder and folder.checkpoint, checkpoint)
    path = None if folder is None else folder.path
    noted = NotedProgress(progress, folder)
    for warning in (*data.warnings, *findings.in_order):
        noted.warned(warning)
    curves = Curves(folder.path) if folder is not None and options.tensorboard else None
    # a fresh run is one that goes on from nothing
    begin = checkpoint or Checkpoint(ended=(), begin=first)
    run = TrainingRun(
        program=program,
        data=data,
        stages=ready,
        folder=folder,
        curves=curves,
        progress=noted,
        options=options,
        safe=Safekeeping(folder, noted, options.most_lost),
        reached=Reached(begin),
        first=first,
    )
    try:
        with (
            held(path),
            end_on_interrupt(second_kills=ranks is None) as stop_asked,
            run.reached.kept(folder, run.safe, noted),
        ):
            return run.through(begin, stop_asked)
    except OSError as error:
        # a full disk, a folder taken away: a message; of other files nothing is known here
        if folder is None or not folder.has(error):
            raise
        file, reason = str(error.filename), (error.strerror or str(error)).lower()
        kept = str(folder.weights) if folder.weights.is_file() else None
        can_go_on = folder.checkpoint.is_file()
        fault = runs.run_not_kept(file, reason, kept, can_go_on=can_go_on)
        raise SpecError((fault,)) from error
    finally:
        # whatever ended it: a session in Python would hold the file open
        noted.close()
        if curves is not None:
            curves.close()


@dataclass(slots=True, kw_only=True)
class TrainingRun:
    """A training in progress, with the receivers of its events and the folder of its files."""

    program: Program
    data: Dataset
    stages: Sequence[tuple[StagePlan, StageData]]
    folder: RunFolder | None
    curves: Curves | None
    progress: NotedProgress
    options: TrainingOptions
    safe: Safekeeping
    reached: Reached
    first: Mapping[str, FloatArray]
    """The weights before the first stage."""
    jumps: LateJumps = field(default_factory=LateJumps)
    course: StageCourse = field(default_factory=StageCourse)

    def through(self, now: Checkpoint, stop_asked: threading.Event) -> TrainingResult:
        """Trains the remaining stages, from the checkpoint `now` to the end of the run."""
        for plan, data in self.stages[len(now.ended) :]:
            result = self._stage(plan, data, now, stop_asked)
            # epoch 0 counts (decision 0480): nothing was better than the weights before it
            if not result.best_epoch:
                has_rate = not plan.optimizer.needs_squares
                self.progress.warned(
                    run_ends.nothing_learned(
                        plan.name, result.best_value, plan.span, has_rate=has_rate
                    )
                )
            hint = self.jumps.hint(plan)
            if hint is not None:
                self.progress.warned(hint)
            for note in self.course.stage_ended(plan, data, result):
                self.progress.warned(note)
            self.progress.stage_ended(stage_end(plan, result))
            now = Checkpoint(ended=(*now.ended, result), begin=result.best)
            self.reached.checkpoint = now
            if self.safe.is_stale:
                self.safe.save(now, now.begin)
        plans = [plan for plan, _ in self.stages]
        for note in unmoved(plans, now.ended, self.first, self.data):
            self.progress.warned(note)
        last, rollouts = self.stages[-1]
        kept = kept_starts(last, self.data, now.ended[-1], self.progress.warned)
        # of several ranks all go on to the errors, though one alone has the folder
        if self.folder is None and self.options.ranks is None:
            self._warn_of_parameters(now.begin, None)
            return replace(self._result(now.begin, now), starts=kept)
        self._finish(now)
        spread = (
            with_bounds(
                standard_errors(last, self.data, now.begin, now.ended[-1].starts),
                last,
                self.data,
                rollouts,
                now.begin,
            )
            if self.options.has_errors
            else without_errors("not estimated in a comparison")
        )
        self._warn_of_parameters(now.begin, spread)
        if self.folder is None:  # another rank writes the run
            return replace(self._result(now.begin, now), starts=kept)
        self.folder.write_starts(kept)
        self.folder.write_parameters(parameters_record(self.program, now.begin, spread))
        self.folder.write_covariance(spread.covariance)
        self.progress.run_ended("finished", zero=zero_slices(self.program, now.begin))
        # a fold keeps its checkpoint until all folds are over
        if self.options.folder is None:
            self.folder.checkpoint.unlink(missing_ok=True)
        return replace(self._result(now.begin, now), standard_errors=spread, starts=kept)

    def _warn_of_parameters(
        self, weights: Mapping[str, FloatArray], found: StandardErrors | None
    ) -> None:
        boxes = self.options.black_boxes
        for warning in parameter_warnings(self.program, weights, found, boxes):
            self.progress.warned(warning)

    def _stage(
        self, plan: StagePlan, data: StageData, now: Checkpoint, stop_asked: threading.Event
    ) -> StageResult:
        """Runs one stage to its end, from its beginning or from the current position."""
        stage = self._attempts(plan, data, now, stop_asked)
        self._announce(plan, data, stage.current.epoch)
        if begins_alike(self.program, plan, now.begin, self.options.redrawn):
            self.progress.warned(stage_errors.same_starts(plan.name, plan.attempts, plan.span))
        try:
            return stage.run()
        except Interrupted:
            best = stage.best or now.begin
            self.safe.save(stage.checkpoint(now), best)
            if self.folder is not None:
                self.folder.become_latest()
            self.progress.run_ended("interrupted")
            raise TrainingInterruptedError(self._result(best, now)) from None
        except NonFiniteLossError as fault:
            best = stage.best or now.begin
            self.safe.save_weights(best)
            diagnostic = self._explained(stage.current, fault)
            self.progress.run_ended("diverged", [diagnostic])
            latest = self.folder is not None and self.folder.is_latest
            found = self._result(best, now)
            raise TrainingDivergedError(diagnostic, found, is_latest=latest) from None

    def _finish(self, now: Checkpoint) -> None:
        """Saves the final weights; for a fold also a checkpoint, until all folds are complete."""
        if self.options.folder is None:
            if self.folder is not None:
                self.safe.save_weights(now.begin)
                self.folder.become_latest()
        elif self.options.ends_in_log and not self.safe.is_stale:
            self.safe.save_weights(now.begin)
        else:
            self.safe.save(now, now.begin)

    def _attempts(
        self,
        plan: StagePlan,
        data: StageData,
        now: Checkpoint,
        stop_asked: threading.Event,
    ) -> StageAttempts:
        as_it_runs = plan  # a kernel that failed in one attempt is not tried in the next

        def opened(attempt: int) -> StageRun:
            nonlocal as_it_runs
            redrawn = self.options.redrawn
            begin = drawn_weights(self.program, plan, now.begin, redrawn, attempt)
            opened = open_engine(as_it_runs, self.data.series, begin, data)
            if self.folder is not None and opened.plan is not as_it_runs:
                self.folder.write_bits_of(opened.plan)
            engine, as_it_runs = opened.engine, opened.plan
            check_same_engine(plan.ranks, engine, as_it_runs.dtype)
            for note in opened.notes if attempt == 0 else ():
                self.progress.warned(note)
            if engine.moved:
                self.progress.warned(weight_errors.moved_off_bound(engine.moved))
            return StageRun(
                plan=opened.plan,
                engine=engine,
                data=data,
                starts=stage_starts(opened.plan, self.data, data, self.progress.warned),
                stop_asked=stop_asked.is_set,
                epoch_ended=lambda event: self._epoch_ended(event, engine, plan),
                between=keep,
                attempt=attempt,
                ranks=plan.ranks,
                rate_found=lambda rate: self.progress.rate_found(plan.name, attempt, rate),
            )

        def keep(ahead: float) -> None:
            if plan.ranks is not None:
                self.reached.checkpoint = attempts.checkpoint(now)
            if self.safe.is_due(ahead):
                self.safe.save(attempts.checkpoint(now), attempts.best or now.begin)

        attempts = StageAttempts(plan, opened, self._left_out)
        attempts.resume(now)
        return attempts

    def _left_out(self, attempt: StageRun, fault: NonFiniteLossError) -> None:
        why = self._explained(attempt, fault)
        number = attempt.attempt + 1
        self.progress.warned(errors.attempt_left_out(number, attempt.plan.attempts, why))

    def _explained(self, attempt: StageRun, fault: NonFiniteLossError) -> Diagnostic:
        now, epoch = attempt.engine.weights(), attempt.epoch + 1
        data = self.data if attempt.starts is None else attempt.starts.data()
        # before the first epoch the best weights are those that the attempt began with
        begun = None if attempt.best_epoch else attempt.best
        same = begun is not None and all(np.array_equal(now[n], begun[n]) for n in begun)
        return explain_divergence(attempt.plan, data, now, fault, epoch, before_updates=same)

    def _announce(self, plan: StagePlan, data: StageData, epoch: int) -> None:
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
                weights=plan.loss_weights if plan.weighs_by_variance else None,
                fed_back=plan.rollout.fed_back,
                epoch=epoch,
                counted=_counted(plan, data.train),
            )
        )

    def _epoch_ended(self, event: EpochEnd, engine: Engine, plan: StagePlan) -> None:
        if plan.ranks is not None:
            check_same_weights(plan.ranks, engine.weights())
        if self.curves is not None:
            self.curves.epoch_ended(event, engine.weights())
        self.progress.epoch_ended(event)
        self.jumps.epoch_ended(event)
        self.course.epoch_ended(event)
        if engine.has_left_out:  # said once: it is the same warning every time
            self.progress.warned(second_order.left_out(plan.name, plan.span))

    def _result(self, weights: Mapping[str, FloatArray], now: Checkpoint) -> TrainingResult:
        path = None if self.folder is None else self.folder.path
        return TrainingResult(
            weights=weights, stages=now.ended, folder=path, warnings=self.progress.said
        )


def _counted(plan: StagePlan, runs: Runs) -> int:
    """Maximum number of rollouts of a stage that score the same row (R2)."""
    rollout = plan.rollout
    if isinstance(rollout.horizon, str):
        return 1
    scored = int(runs.steps.max(initial=1)) - rollout.skip
    return min(-(-scored // rollout.stride), len(runs))
