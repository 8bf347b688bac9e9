"""Runs one stage, once per attempt: shuffled epochs, the monitor, best weights, early stopping.

Attempts run one after the other, because the batches of one attempt already use all SIMD lanes and
threads.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.training.engines.engine import Engine, LossSums, NonFiniteLossError, StartsEstimator
from msnn.training.plans.epochs import (
    NO_REDUCTIONS,
    Reductions,
    after_epoch,
    order_key,
    rate_factor,
)
from msnn.training.plans.loss_terms import has_priors, residuals_of
from msnn.training.plans.stage_data import StageData
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.plans.stage_result import EstimatedStarts, StageResult, Weights, monitor_order
from msnn.training.ranks.training_ranks import TrainingRanks
from msnn.training.records.checkpoint import Checkpoint, TrainingPosition
from msnn.training.records.progress import EpochEnd
from msnn.training.stages.monitor import loss_values, monitor, weighted_total
from msnn.training.stages.rate_search import searched_rate
from msnn.training.stages.stage_starts import StageStarts


class Interrupted(Exception):  # noqa: N818  (an event, no error)
    """The user interrupted the training, between two batches."""


@dataclass(slots=True, kw_only=True)
class StageRun:
    """One attempt at a stage; `run` trains its epochs with an engine.

    A stage with `starts:` in its spec has several attempts, from different initial weights.
    """

    plan: StagePlan
    engine: Engine
    data: StageData
    stop_asked: Callable[[], bool]
    epoch_ended: Callable[[EpochEnd], None]
    between: Callable[[float], None] = lambda seconds: None
    """Called at positions from which the run can resume, with the expected seconds to the next."""
    starts: StageStarts | None = None
    """Estimates initial states of runs; None if the states define them."""
    attempt: int = 0
    epoch: int = 0
    batch: int = 0
    best_value: float = float("inf")
    best_epoch: int = 0
    best: Weights | None = None
    best_starts: EstimatedStarts | None = None
    """Initial states that belong to the best weights, if training estimates them."""
    sums: LossSums | None = None
    left_out: int = 0
    """Batches of the current epoch without a step."""
    found_rate: float = 1.0
    """The learning rate if it is searched, else 1."""
    rate_found: Callable[[float], None] = lambda rate: None
    """Receives a learning rate that was found."""
    spread: float = 0.0
    """ŝ²/n of the current epoch."""
    ranks: TrainingRanks | None = None
    """The processes that train with this one."""
    reductions: Reductions = NO_REDUCTIONS
    _began: float = field(init=False, default_factory=time.monotonic)
    _watching: float = field(init=False, default=0.0)
    """Seconds spent on the monitor."""
    _started: Runs | None = field(init=False, default=None)
    """The training rollouts whose initial states were estimated last."""
    _kept_starts: Weights = field(init=False, default_factory=dict[str, FloatArray])
    """Initial states of the epoch in which the training was interrupted."""

    def resume(self, place: TrainingPosition) -> None:
        """Restores the state of this attempt from a checkpoint."""
        self.engine.restore(place.engine)
        self.epoch, self.batch = place.epoch, place.batch
        self.best_value, self.best_epoch = place.best_value, place.best_epoch
        self.best, self.sums, self.left_out = place.best, place.sums, place.left_out
        self.best_starts = place.best_starts
        self.engine.has_left_out = place.left_out > 0  # is said when the epoch ends
        self.reductions, self.spread = place.reductions, place.spread
        self.found_rate = place.found_rate
        self._kept_starts = place.starts
        # seconds go on counting where the interrupted run stopped
        self._began = time.monotonic() - place.seconds

    def run(self) -> StageResult:
        """Trains until the last epoch, early stopping or convergence of the optimiser.

        Raises NonFiniteLossError and Interrupted.
        """
        if self.best is None:
            self._began = time.monotonic()
            # epoch 0 counts: what training cannot improve it does not replace (decision 0480)
            self._keep_if_best(self._monitor())
            self._search_rate()
        pace = Pace(self.engine.batches_a_call)
        while (reason := self._reason_to_end()) is None:
            runs, rate = self.data.in_epoch(self.epoch), self._rate()
            sums = self._run_epoch(runs, rate, pace)
            self.epoch, self.batch, self.sums, self.left_out = self.epoch + 1, 0, None, 0
            value = self._monitor()
            self._keep_if_best(value)
            self.reductions = after_epoch(
                self.plan.schedule, self.epoch, self._better, self.reductions
            )
            self._report(sums, value, runs, rate)
            self.between(pace.seconds)
        assert self.best is not None
        if self.starts is not None:
            self.starts.report()
        return StageResult(
            best=self.best,
            best_value=self.best_value,
            best_epoch=self.best_epoch,
            epochs=self.epoch,
            reason=reason,
            seconds=self._seconds,
            attempt=self.attempt,
            starts=self.best_starts,
        )

    def place(self) -> TrainingPosition | None:
        """The current progress of the attempt for a checkpoint; None before it has begun."""
        if self.best is None:
            return None
        return TrainingPosition(
            epoch=self.epoch,
            batch=self.batch,
            sums=self.sums or {},
            left_out=self.left_out,
            best_value=self.best_value,
            best_epoch=self.best_epoch,
            best=self.best,
            best_starts=self.best_starts,
            engine=self.engine.state(),
            reductions=self.reductions,
            spread=self.spread,
            found_rate=self.found_rate,
            seconds=self._seconds,
            # between epochs they are found anew
            starts={} if self.starts is None or not self.batch else self.starts.values(),
        )

    @property
    def _seconds(self) -> float:
        return time.monotonic() - self._began

    @property
    def _better(self) -> int:
        """The epoch from which `patience` counts epochs without improvement."""
        return max(self.best_epoch, self.plan.whole_from)

    def _reason_to_end(self) -> str | None:
        """The reason to end, determined by the position only, so that a resumed run ends equally.

        None if training continues.
        """
        # converged on the short rollouts of a curriculum is not converged
        if self.engine.finished is not None and self.epoch > self.plan.whole_from:
            return self.engine.finished
        waited = self.epoch - self._better
        if self.plan.patience is not None and waited >= self.plan.patience:
            return f"no better for {waited} epochs"
        return "done" if self.epoch >= self.plan.epochs else None

    def _rate(self) -> float:
        """The factor of learning rates in the next epoch."""
        plan = self.plan
        factor = rate_factor(plan.schedule, self.epoch, plan.epochs, self.reductions)
        return self.found_rate * factor

    def _search_rate(self) -> None:
        if self.plan.searches_rate:
            runs = self.data.in_epoch(0)
            spread = self._spread(runs)
            self.found_rate = searched_rate(self.plan, self.engine, runs, self.attempt, spread)
            self.rate_found(self.found_rate)

    def _monitor(self) -> float:
        began = time.monotonic()
        if self.starts is not None:
            self._find_watched_starts(self.starts)
        value = monitor(self.plan, self.engine.evaluate, self.data, self.engine.weights)
        self._watching = time.monotonic() - began
        return value

    def _run_epoch(self, runs: Runs, rate: float, pace: Pace) -> LossSums:
        key = order_key(self.plan.seed, self.plan.index, self.epoch, self.attempt)
        order = self.engine.order(len(runs), key)
        if self.starts is not None:
            self._find_starts(self.starts, runs)
        # an epoch that goes on after an interrupt keeps the spread with which it began
        if self.batch == 0:
            self.spread = self._spread(runs)
        self.engine.begin_epoch(self.epoch, rate, self.attempt, self.spread)
        size = self.plan.batch or max(len(order), 1)
        sums = self.sums or {}
        # a last batch that is smaller is the same as one filled up with members of weight 0
        count = -(-len(order) // size)
        while self.batch < count:
            several = min(pace.batches, count - self.batch)
            members = order[self.batch * size : (self.batch + several) * size]
            began = time.monotonic()
            sums = self.engine.train_batches(runs, size, members, sums)
            seconds, stops = self._agreed(time.monotonic() - began, self.stop_asked())
            pace.called(several, seconds)
            self.batch, self.sums = self.batch + several, sums
            self.left_out += self.engine.left_out
            if stops:
                raise Interrupted
            self.between(pace.seconds if self.batch < count else self._watching)
        if count and self.left_out == count:  # it would do the same for ever
            raise NonFiniteLossError(runs)
        return sums

    def _agreed(self, seconds: float, stops: bool) -> tuple[float, bool]:
        """The longest duration of all ranks, and True if any of them stops.

        So all ranks stop after the same batch.
        """
        if self.ranks is None:
            return seconds, stops
        longest, any_stops = self.ranks.most((seconds, float(stops)))
        return longest, bool(any_stops)

    def _find_starts(self, starts: StageStarts, runs: Runs) -> None:
        """Estimates the initial states of an epoch; only the first ones if training estimates
        them.
        """
        if self.batch and self._kept_starts:
            found = starts.kept(runs, self._kept_starts)
        elif self.plan.estimates_starts and runs is self._started:
            return
        else:
            found = starts.for_training(runs, self.engine.weights())
        self._started, self._kept_starts = runs, {}
        self.engine.write(found, watched=False)

    def _find_watched_starts(self, starts: StageStarts) -> None:
        """Estimates the initial states of watched rollouts, unless training estimates them."""
        if self.plan.estimates_starts and self.data.watches_training:
            self._find_starts(starts, self.data.in_epoch(self.epoch))
        else:
            found = starts.for_watching(self.data.watched, self.engine.weights())
            self.engine.write(found, watched=True)

    def _spread(self, runs: Runs) -> float:
        """ŝ²/n at the end of the previous epoch, the weight of priors."""
        if not has_priors(self.plan):
            return 0.0
        return residuals_of(self.plan, self.engine.measure(runs), runs).spread

    def _keep_if_best(self, value: float) -> None:
        if self.best is None or monitor_order(value) < monitor_order(self.best_value):
            self.best, self.best_value, self.best_epoch = self.engine.weights(), value, self.epoch
            if isinstance(self.engine, StartsEstimator):
                self.best_starts = self.engine.starts()

    def _report(self, sums: LossSums, watched: float, runs: Runs, rate: float) -> None:
        losses = loss_values(self.plan, sums)
        self.epoch_ended(
            EpochEnd(
                stage=self.plan.name,
                attempt=self.attempt + 1,
                attempts=self.plan.attempts,
                epoch=self.epoch,
                epochs=self.plan.epochs,
                total=weighted_total(self.plan, losses),
                losses=losses,
                monitor=watched,
                best=self.best_value,
                best_epoch=self.best_epoch,
                lr=None if self.plan.lr is None else self.plan.lr * rate,
                horizon=int(runs.steps.max()),
                seconds=self._seconds,
            )
        )


CALL = 0.25
"""Maximum seconds per call: the delay of interrupts and time limits."""


@dataclass(slots=True)
class Pace:
    """Chooses how many batches the next call of an engine trains, by the duration of the last one.

    A call should take about `CALL` seconds, so that a training stops soon after Ctrl-C. The number
    begins at 1 and doubles. A batch that takes longer is a call of its own.
    """

    most: int
    seconds: float = 0.0
    """Duration of the last call."""
    batches: int = 1
    """Number of batches of the next call."""

    def called(self, batches: int, seconds: float) -> None:
        """Records the duration of a call."""
        self.seconds = seconds
        fitting = int(batches * CALL / seconds) if seconds > 0.0 else self.most
        self.batches = max(1, min(self.most, 2 * self.batches, fitting))


@dataclass(slots=True)
class StageAttempts:
    """The attempts at one stage, one after the other; `leader` is the best result so far."""

    plan: StagePlan
    opened: Callable[[int], StageRun]
    """Opens the attempt with that number."""
    diverged: Callable[[StageRun, NonFiniteLossError], None]
    """Receives diverged attempts, which are skipped."""
    current: StageRun = field(init=False)
    leader: StageResult | None = None

    def __post_init__(self) -> None:
        self.current = self.opened(0)

    @property
    def best(self) -> Weights | None:
        """The best weights so far."""
        ended, now = self.leader, self.current
        if ended is None or (now.best is not None and _leads(now.best_value, ended)):
            return now.best
        return ended.best

    def resume(self, checkpoint: Checkpoint) -> None:
        """Continues from a checkpoint of this stage, also one at its beginning."""
        self.leader = checkpoint.leader
        if checkpoint.attempt:
            self.current = self.opened(checkpoint.attempt)
        if checkpoint.place is not None:
            self.current.resume(checkpoint.place)

    def checkpoint(self, before: Checkpoint) -> Checkpoint:
        """A checkpoint with the current progress; `before` is the one with which this stage
        began.
        """
        now = self.current
        return Checkpoint(
            ended=before.ended,
            begin=before.begin,
            attempt=now.attempt,
            leader=self.leader,
            place=now.place(),
        )

    def run(self) -> StageResult:
        """The result of the best attempt.

        Raises Interrupted, and NonFiniteLossError if all attempts diverge. A checkpoint at the end
        of an attempt continues with its last epoch.
        """
        while True:
            last = self.current.attempt + 1 == self.plan.attempts
            try:
                self._compare(self.current.run())
            except NonFiniteLossError as fault:
                if last and self.leader is None:
                    raise
                self.diverged(self.current, fault)
            if last:
                break
            self.current = self.opened(self.current.attempt + 1)
        assert self.leader is not None
        return self.leader

    def _compare(self, result: StageResult) -> None:
        if self.leader is None or _leads(result.best_value, self.leader):
            self.leader = result


def _leads(value: float, leader: StageResult) -> bool:
    return monitor_order(value) < monitor_order(leader.best_value)
