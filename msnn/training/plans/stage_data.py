"""Selects the rollouts of a stage for training, and those that select the best weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from compiler.ir.program import Program
from msnn.data.dataset import BoolArray, Dataset
from msnn.data.starts import Runs, reach
from msnn.simulation.rollout_plan import counted_rows, set_rollouts
from msnn.simulation.row_factors import check_classes, check_row_factors
from msnn.training.plans.disk_checks import check_on_disk
from msnn.training.plans.fixed_starts import fixed_starts
from msnn.training.plans.known_terms_of_stage import has_priors
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Findings

TRAIN, VALIDATION = "train", "val"


@dataclass(frozen=True, slots=True)
class Lesson:
    """Shorter training rollouts until the end of epoch `until`."""

    until: int
    runs: Runs


@dataclass(frozen=True, slots=True, kw_only=True)
class StageData:
    """Rollouts of a stage, and masks of the scored rows t if not all are scored."""

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
    """The rollouts of a stage; None after reporting that there are none."""
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
    if watched_set == TRAIN and _steps_lower_the_total(plan, train):
        watched = train
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
