"""Runs one stage: epochs of shuffled batches, the monitor, the best weights, early stopping."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from msnn.data.starts import Runs
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import Engine, LossSums
from msnn.training.monitor import loss_values, monitor, weighted_total
from msnn.training.plans.epoch_order import order_key
from msnn.training.plans.learning_rate import NO_REDUCTIONS, Reductions, after_epoch, rate_factor
from msnn.training.plans.stage_data import StageData
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.plans.stage_result import StageResult, Weights
from msnn.training.records.checkpoint import Checkpoint
from msnn.training.records.progress import EpochEnd


class Interrupted(Exception):  # noqa: N818  (an event, no error)
    """The user asked for an end; `checkpoint` is where to go on."""

    def __init__(self, checkpoint: Checkpoint) -> None:
        super().__init__("training was interrupted")
        self.checkpoint = checkpoint


@dataclass(slots=True)
class StageRun:
    """One attempt at a stage with its engine and data; `run` goes through its epochs."""

    plan: StagePlan
    engine: Engine
    data: StageData
    spec_hash: str
    stop_asked: Callable[[], bool]
    epoch_ended: Callable[[EpochEnd], None]
    attempt: int = 0
    epoch: int = 0
    batch: int = 0
    best_value: float = float("inf")
    best_epoch: int = 0
    best: Weights | None = None
    sums: LossSums | None = None
    reductions: Reductions = NO_REDUCTIONS

    def resume(self, checkpoint: Checkpoint) -> None:
        """Goes on where a checkpoint of this stage was made."""
        self.engine.restore(checkpoint.engine)
        self.epoch, self.batch = checkpoint.epoch, checkpoint.batch
        self.best_value, self.best_epoch = checkpoint.best_value, checkpoint.best_epoch
        self.best, self.sums = checkpoint.best, checkpoint.sums
        self.reductions = checkpoint.reductions

    def run(self) -> StageResult:
        """Trains to the last epoch, the early stop or the optimiser's own end.

        Raises NonFiniteLossError, Interrupted.
        """
        began = time.monotonic()
        if self.best is None:
            self._keep_if_best(monitor(self.plan, self.engine.evaluate, self.data.watched))
        reason = "done"
        while self.epoch < self.plan.epochs:
            runs, rate = self.data.in_epoch(self.epoch), self._rate()
            sums = self._run_epoch(runs, rate)
            self.epoch, self.batch, self.sums = self.epoch + 1, 0, None
            value = monitor(self.plan, self.engine.evaluate, self.data.watched)
            self._keep_if_best(value)
            self._report(sums, value, runs, rate, time.monotonic() - began)
            better = max(self.best_epoch, self.plan.whole_from)
            self.reductions = after_epoch(self.plan.schedule, self.epoch, better, self.reductions)
            if self.engine.finished is not None and self.epoch > self.plan.whole_from:
                reason = self.engine.finished
                break
            waited = self.epoch - better
            if self.plan.patience is not None and waited >= self.plan.patience:
                reason = f"no better for {waited} epochs"
                break
        assert self.best is not None
        return StageResult(
            self.best,
            self.best_value,
            self.best_epoch,
            self.epoch,
            reason,
            time.monotonic() - began,
            self.attempt,
        )

    def checkpoint(self) -> Checkpoint:
        """Where the stage stands now."""
        assert self.best is not None
        return Checkpoint(
            self.spec_hash,
            self.plan.index,
            self.attempt,
            self.epoch,
            self.batch,
            self.sums or {},
            self.best_value,
            self.best_epoch,
            self.best,
            self.engine.state(),
            None,
            self.reductions,
        )

    def _rate(self) -> float:
        """What learning rates are multiplied by in the next epoch."""
        plan = self.plan
        return rate_factor(plan.schedule, self.epoch, plan.epochs, self.reductions)

    def _run_epoch(self, runs: Runs, rate: float) -> LossSums:
        key = order_key(self.plan.seed, self.plan.index, self.epoch, self.attempt)
        order = self.engine.order(len(runs), key)
        self.engine.begin_epoch(self.epoch, rate, self.attempt)
        size = self.plan.batch or max(len(order), 1)
        sums = self.sums or {}
        # a last batch that is smaller is the same as one filled up with members of weight 0
        count = -(-len(order) // size)
        while self.batch < count:
            several = min(self.engine.batches_a_call, count - self.batch)
            members = order[self.batch * size : (self.batch + several) * size]
            found = self.engine.train_batches(runs, size, members)
            sums = {name: sums.get(name, LossSum(0.0, 0)) + value for name, value in found.items()}
            self.batch, self.sums = self.batch + several, sums
            if self.stop_asked():
                raise Interrupted(self.checkpoint())
        return sums

    def _keep_if_best(self, value: float) -> None:
        first_finite = np.isfinite(value) and not np.isfinite(self.best_value)
        if self.best is None or value < self.best_value or first_finite:
            self.best, self.best_value, self.best_epoch = self.engine.weights(), value, self.epoch

    def _report(
        self, sums: LossSums, watched: float, runs: Runs, rate: float, seconds: float
    ) -> None:
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
                seconds=seconds,
            )
        )
