"""Runs a stage once per attempt of `starts:`, from different initial values; the best counts.

Attempts run one after the other, because the batches of one attempt already use all SIMD lanes and
threads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from msnn.training.engines.engine import NonFiniteLossError
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.plans.stage_result import StageResult, Weights, monitor_order
from msnn.training.records.checkpoint import Checkpoint
from msnn.training.stages.stage_run import StageRun


@dataclass(slots=True)
class StageAttempts:
    """The attempts at one stage; `current` is the running or last one."""

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
        """The current position of a run that began this stage at `before`."""
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
