"""Selects the rollouts of a stage for training and its monitor, and weights default losses.

Without `losses:`, each output that predicts a signal has the loss mse. A sum of squared errors in
Pa² and K² would be dominated by Pa². Each loss is divided by the variance of its signal over the
training rows if signals have different units. So it is if their standard deviations differ by more
than a factor of 10. The total is then the sum of the unexplained fractions of variance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from compiler.ir import ops
from compiler.ir.program import Loss, Program
from msnn.data.dataset import BoolArray, Dataset
from msnn.data.rollout_rows import Runs, reach
from msnn.errors.data.files import not_on_disk
from msnn.simulation.rollout import check_classes, check_row_factors
from msnn.simulation.rollout_plan import counted_rows, set_rollouts
from msnn.training.plans.loss_terms import has_priors
from msnn.training.plans.stage_plan import StagePlan, fixed_starts
from spec_schema.diagnostics.diagnostic import Findings

TRAIN, VALIDATION = "train", "val"


@dataclass(frozen=True, slots=True)
class Lesson:
    """A part of a curriculum: until the end of epoch `until`, the rollouts `runs` are trained."""

    until: int
    runs: Runs


@dataclass(frozen=True, slots=True, kw_only=True)
class StageData:
    """The rollouts of a stage: for training, and those on which the monitor is computed
    (`watched`).

    `train_rows` and `watched_rows` mask the scored rows (rows,) of each loss; None means all.
    """

    train: Runs
    train_rows: Mapping[str, BoolArray] | None
    watched: Runs
    watched_rows: Mapping[str, BoolArray] | None
    watched_set: str
    lessons: tuple[Lesson, ...] = ()

    @property
    def watches_training(self) -> bool:
        """True if the training rows also select the best weights."""
        return self.watched_set == TRAIN

    def in_epoch(self, epoch: int) -> Runs:
        """The training rollouts after `epoch` completed epochs."""
        return next((each.runs for each in self.lessons if epoch < each.until), self.train)


def stage_data(plan: StagePlan, data: Dataset, findings: Findings) -> StageData | None:
    """Selects the rollouts of a stage from the sets of the data; reports to `findings`, and is
    None, if there are none.
    """
    if data.is_on_disk:
        check_on_disk(plan, findings)
        if findings.failed:
            return None
    rollout, span = plan.rollout, plan.span
    wanted_by = f"stage `{plan.name}`"
    train = set_rollouts(rollout, data, TRAIN, rollout.stride, wanted_by, span, findings)
    watched_set = VALIDATION if data.has(VALIDATION) else TRAIN
    watched = set_rollouts(rollout, data, watched_set, None, wanted_by, span, findings)
    lessons: list[Lesson] = []
    for phase in plan.phases:
        shorter = replace(rollout, horizon=phase.horizon)
        # its findings are dropped: those of the whole horizon are told already
        runs = set_rollouts(shorter, data, TRAIN, rollout.stride, wanted_by, span, Findings())
        if runs is not None:  # there are at least those of the whole horizon
            lessons.append(Lesson(phase.until, runs))
    if train is None or watched is None:
        return None
    train_rows = counted_rows(rollout, data, TRAIN)
    watched_rows = counted_rows(rollout, data, watched_set)
    check_row_factors(rollout.program, data, train, train_rows, findings)
    check_classes(rollout.program, data, train, findings)
    if watched_set != TRAIN:
        check_row_factors(rollout.program, data, watched, watched_rows, findings)
        check_classes(rollout.program, data, watched, findings)
    if findings.failed:
        return None
    if watched_set == TRAIN and (_steps_lower_the_total(plan, train) or watched.begin_as(train)):
        watched = train  # one array of rollouts, which may be as many as rows
    if _starts_inside(rollout.program, data, train):
        findings.report(*fixed_starts(plan))
    return StageData(
        train=train,
        train_rows=train_rows,
        watched=watched,
        watched_rows=watched_rows,
        watched_set=watched_set,
        lessons=tuple(lessons),
    )


def _steps_lower_the_total(plan: StagePlan, train: Runs) -> bool:
    """True if the training total itself must select the best weights.

    Non-overlapping rollouts score fewer rows, fewest with a long `skip`. Their minimum differs from
    that of a stage that uses all rollouts in each step, or that weighs its rows against priors
    (decision 0480). With small batches, noise exceeds that difference.
    """
    return plan.batch is None or len(train) <= plan.batch or has_priors(plan)


def _starts_inside(program: Program, data: Dataset, runs: Runs) -> bool:
    """True if a rollout starts after the first possible row of its recording."""
    far = reach(program)
    first = np.array([record.start + far.back for record in data.records])
    return not np.isin(runs.t0, first).all()


def check_on_disk(plan: StagePlan, findings: Findings) -> None:
    """Reports what a stage needs of all rows at once, if the data are too large for memory."""
    stage, program = f"stage `{plan.name}`", plan.rollout.program
    scaled = [name for name in plan.trained if program.parameter(name).scales_by_data]
    reasons = {
        f"{stage} begins with layers that are fitted to all rows at once": bool(program.fits),
        f"{stage} draws dropout for every row": bool(plan.masks),
        f"{stage} fits where runs start, a number for every row": plan.rollout.starts is not None,
        f"{stage} looks at the factors of all rows at once": any(
            loss.rows is not None for loss in program.losses
        ),
        f"{stage} takes the scale of `{', '.join(scaled)}` from all rows at once": bool(scaled),
    }
    for reason, applies in reasons.items():
        if applies:
            findings.report(not_on_disk(reason, plan.span))


def compared_signal(program: Program, loss: Loss) -> str | None:
    """The signal whose samples are the target of a loss; None if the target is another value."""
    node = None if loss.target is None else program.step[loss.target]
    # these show samples of the signal in another shape
    while node is not None and isinstance(node.op, ops.Broadcast | ops.Reshape | ops.Slice):
        node = program.step[node.args[0]]
    if node is None or not isinstance(node.op, ops.ReadSamples):
        return None
    return node.op.signal


MOST_UNLIKE = 10.0
"""Maximum ratio of standard deviations for which signals of one unit are summed unweighted."""


def with_default_weights(plans: Sequence[StagePlan], data: Dataset) -> list[StagePlan]:
    """Gives stages without `losses:` their loss weights, 1/variance of the signals if needed."""
    return [_weighed(plan, data) for plan in plans]


def _weighed(plan: StagePlan, data: Dataset) -> StagePlan:
    losses = [loss for loss in plan.program.losses if loss.is_default]
    if plan.has_written_weights or len(losses) < 2:
        return plan
    variances = {loss.name: _variance(plan.program, loss, data) for loss in losses}
    units = {plan.program.step[loss.prediction].type.unit for loss in losses}
    deviations = np.sqrt(list(variances.values()))
    if len(units) == 1 and deviations.max() <= MOST_UNLIKE * deviations.min():
        return plan
    weights = {name: 1.0 / variance for name, variance in variances.items()}
    return replace(plan, loss_weights={**plan.loss_weights, **weights}, weighs_by_variance=True)


def _variance(program: Program, loss: Loss, data: Dataset) -> float:
    """Mean variance of the elements of a signal; for a constant signal, its mean square."""
    signal = compared_signal(program, loss)
    assert signal is not None, "an output predicts a signal"
    rows = data.measured_values(signal)[data.in_set(TRAIN)]
    known = np.where(np.isfinite(rows), rows, np.nan).reshape(len(rows), -1)
    known = known[:, np.isfinite(known).any(axis=0)]
    if not known.size:
        return 1.0
    variance = float(np.mean(np.nanvar(known, axis=0)))
    return variance or float(np.nanmean(known * known)) or 1.0
