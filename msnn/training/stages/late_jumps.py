"""Detects monitors that jump late in a stage, because steps are too long to converge."""

from __future__ import annotations

import math

from msnn.errors.learning import knowledge
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.records.progress import EpochEnd
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.sections.optimizers import (
    Adam,
    AdamW,
    Lbfgs,
    LevenbergMarquardt,
    Sgd,
    TorchOptimizer,
)

LATE = 0.5
"""Fraction of the epochs after which a stage is late."""
JUMP = 2.0
"""Factor over the best monitor that counts as a jump."""
OFTEN = 0.1
"""Minimum fraction of late epochs with a jump; a single jump may be a rare batch."""
SHARE = 0.3
"""Suggested factor of the learning rate."""


class LateJumps:
    """Receives the epochs of one attempt at a stage."""

    def __init__(self) -> None:
        self._late, self._jumps = 0, 0
        self._largest, self._at, self._rate = 0.0, 0, 0.0

    def epoch_ended(self, event: EpochEnd) -> None:
        """Counts a late epoch, and its jump if there is one."""
        if event.epoch == 1:
            # the next of several attempts: what an earlier one did says nothing of it
            self.__init__()
        if event.lr is None or event.epoch <= LATE * event.epochs:
            return
        self._late += 1
        # losses of kind `mean` may be 0 or negative, of which there is no multiple
        ratio = event.monitor / event.best if event.best > 0 else 1.0
        if ratio > JUMP and math.isfinite(ratio):
            self._jumps += 1
            if ratio > self._largest:
                self._largest, self._at, self._rate = ratio, event.epoch, event.lr

    def hint(self, plan: StagePlan) -> Diagnostic | None:
        """A hint with a lower learning rate; None without jumps."""
        key = _key(plan)
        if key is None or self._jumps <= OFTEN * self._late:
            return None
        return knowledge.jumps_late(
            stage=plan.name,
            epoch=self._at,
            ratio=self._largest,
            key=f"train.{plan.index}.optimizer.{key}",
            rate=f"{SHARE * self._rate:.1g}",
            schedule=None if plan.schedule is not None else f"train.{plan.index}.schedule",
            span=plan.span,
        )


def _key(plan: StagePlan) -> str | None:
    """The key of the learning rate; None for methods with their own step size."""
    match plan.optimizer:
        case Adam():
            return "adam.lr"
        case AdamW():
            return "adamw.lr"
        case Sgd():
            return "sgd.lr"
        case TorchOptimizer():
            return "torch.options.lr"
        case Lbfgs() | LevenbergMarquardt():
            return None
