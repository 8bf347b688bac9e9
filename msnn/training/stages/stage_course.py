"""Warns about the course of a stage: one loss dominates, late jumps, parameters that do not
move.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import Dataset, FloatArray
from msnn.errors.learning import stages, training
from msnn.training.plans.loss_terms import has_priors
from msnn.training.plans.stage_data import StageData
from msnn.training.plans.stage_plan import TOTAL, StagePlan
from msnn.training.plans.stage_result import StageResult
from msnn.training.records.learned.standard_errors import ways_left
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

ALONE = 0.95
"""Fraction of the total above which a single loss dominates."""
FELL = 2.0
"""Factor by which the training loss may still fall after the chosen epoch of least squares."""
FAR_ABOVE = 10.0
"""Factor of the training loss above which a monitor is reported."""
NOTHING = 1e-6
"""Fraction of the first epoch's loss that counts as zero."""
HARDLY = 0.01
"""Fraction of its scale that a parameter must move."""

Weights = Mapping[str, FloatArray]


class StageCourse:
    """A receiver of epochs that warns at the end of a stage about what they have shown."""

    def __init__(self) -> None:
        self._first: dict[int, EpochEnd] = {}
        self._best: dict[int, EpochEnd] = {}
        self._after: dict[int, EpochEnd] = {}
        self._last: dict[int, EpochEnd] = {}

    def epoch_ended(self, event: EpochEnd) -> None:
        """Records an epoch; a resumed attempt only has the later ones."""
        if event.epoch == 1:
            self._first[event.attempt] = event
        if event.best_epoch == event.epoch:
            self._best[event.attempt] = event
            self._after.pop(event.attempt, None)
        elif event.best_epoch == event.epoch - 1:
            self._after[event.attempt] = event
        self._last[event.attempt] = event

    def stage_ended(
        self, plan: StagePlan, data: StageData, result: StageResult
    ) -> list[Diagnostic]:
        """Warnings about the stage; clears the records for the next one."""
        number = result.attempt + 1
        first, best, after, last = (
            kept.get(number) for kept in (self._first, self._best, self._after, self._last)
        )
        self._first, self._best, self._after, self._last = {}, {}, {}, {}
        found: list[Diagnostic | None] = []
        if first is not None and last is not None:
            found.append(_alone(plan, first.losses, last.losses))
            # epoch 0 ends without an event: it is what the first epoch begins with
            known = after if not result.best_epoch else best
            if known is not None and known.best_epoch == result.best_epoch:
                kept = _Kept(result.best_epoch, result.best_value, known.horizon)
                found.append(_kept(plan, data, first, kept, after, last))
        return [each for each in found if each is not None]


def unmoved(
    plans: Sequence[StagePlan], results: Sequence[StageResult], first: Weights, data: Dataset
) -> list[Diagnostic]:
    """A warning about parameters that no stage has moved by a fraction of their scale.

    It omits parameters that moved most of the way to their minimum: 1 K is little for a level of
    294 K, but may be the full distance.
    """
    moved: dict[str, bool] = {}
    trained_by: dict[str, StagePlan] = {}
    begin = first
    for plan, result in zip(plans, results, strict=True):
        # a step of least squares is as long as it has to be; nothing better moves nothing
        stays = plan.optimizer.takes_all_starts or not result.best_epoch
        for name in plan.trained:
            if plan.lr_factors.get(name) != 0.0:
                found = stays or _has_moved(plan, name, begin[name], result.best[name])
                moved[name] = moved.get(name, False) or found
                trained_by[name] = plan
        begin = result.best
    names = [name for name, found in moved.items() if not found]
    for plan in {id(trained_by[name]): trained_by[name] for name in names}.values():
        ways = ways_left(plan, data, begin)
        for name in [one for one in names if trained_by[one] is plan] if ways else ():
            assert ways is not None
            if np.all(np.abs(ways[name]) <= np.abs(begin[name] - first[name])):
                names.remove(name)
    if not names:
        return []
    return [training.hardly_moved(names, plans[-1].program.parameter(names[0]).span)]


def _has_moved(plan: StagePlan, name: str, begin: FloatArray, end: FloatArray) -> bool:
    scale = plan.program.parameter(name).scale
    largest = float(np.max(np.abs(begin), initial=0.0))
    # a scale that nobody wrote is 1, whatever the size of the number
    size = largest if scale == 1.0 and largest else scale
    return bool(np.any(np.abs(end - begin) >= HARDLY * size))


def _alone(
    plan: StagePlan, first: Mapping[str, float], last: Mapping[str, float]
) -> Diagnostic | None:
    """A warning about a loss that is nearly the whole total from the first epoch to the last."""
    # the advice, 1/variance, is what such a stage already has
    if plan.weighs_by_variance:
        return None
    early, late = _shares(plan, first), _shares(plan, last)
    if len(late) < 2 or not late.keys() <= early.keys():
        return None
    name = max(late, key=lambda each: late[each])
    share = min(early[name], late[name])
    if not share > ALONE:
        return None
    return training.decides_alone(name, share, plan.name, [n for n in late if n != name], plan.span)


def _shares(plan: StagePlan, losses: Mapping[str, float]) -> dict[str, float]:
    """The fraction of each entry in the sum of losses with targets."""
    parts: dict[str, float] = {}
    for loss in plan.program.losses:
        weight = plan.loss_weights[loss.name]
        if loss.target is not None and weight > 0 and loss.name in losses:
            parts[loss.entry] = parts.get(loss.entry, 0.0) + weight * losses[loss.name]
    total = sum(parts.values())
    if not (total > 0 and math.isfinite(total)):
        return {}
    return {name: part / total for name, part in parts.items()}


@dataclass(frozen=True, slots=True)
class _Kept:
    """The epoch whose weights a stage keeps: its monitor and its horizon."""

    epoch: int
    monitor: float
    horizon: int


def _kept(
    plan: StagePlan,
    data: StageData,
    first: EpochEnd,
    best: _Kept,
    after: EpochEnd | None,
    last: EpochEnd,
) -> Diagnostic | None:
    """A warning if the best epoch of the validation rows fits the training rows far worse.

    `first`, `best` and `last` are the first, the selected and the last epoch, `after` the one after
    the selected. A total below a fraction of that of `first` counts as nothing. None where the two
    totals cannot be compared: other rows, priors, a monitor of its own.
    """
    # priors are in one of the two totals, a monitor of its own is another loss
    alike = plan.monitor == TOTAL and not has_priors(plan) and best.horizon == last.horizon
    nothing = NOTHING * first.total
    if data.watches_training or not alike or not nothing >= 0:
        return None
    # a least-squares epoch has the total before its one step: that of the weights which the best
    # epoch ends with stands in the epoch after it
    at_kept = after.total if plan.optimizer.needs_squares and after is not None else 0.0
    is_kept = at_kept > max(FELL * last.total, nothing)
    # on rows that nobody trained on the weights that are kept, against what training reaches: with
    # any optimizer the total of the last epoch is of weights before its end, and rather too high
    if not is_kept and not best.monitor > max(FAR_ABOVE * last.total, nothing):
        return None
    return training.validation_decided(
        stage=plan.name,
        rollouts=len(data.watched),
        watched=data.watched_set,
        epoch=best.epoch,
        epochs=last.epoch,
        is_on_the_way=is_kept,
        value=at_kept if is_kept else best.monitor,
        last=last.total,
        span=plan.span,
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
    """A receiver of epochs that looks for jumps of the monitor late in an attempt at a stage."""

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
        """A diagnostic that proposes a lower learning rate; None if there were few jumps."""
        key = _key(plan)
        if key is None or self._jumps <= OFTEN * self._late:
            return None
        return stages.jumps_late(
            stage=plan.name,
            epoch=self._at,
            ratio=self._largest,
            key=f"train.{plan.index}.optimizer.{key}",
            rate=f"{SHARE * self._rate:.1g}",
            schedule=None if plan.schedule is not None else f"train.{plan.index}.schedule",
            span=plan.span,
        )


def _key(plan: StagePlan) -> str | None:
    """The key of the spec that has the learning rate; None for methods with their own step size."""
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
