"""The rollouts of a stage: those it trains on, and those that decide which weights are best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import assert_never

import numpy as np

from compiler.ir.liveness import needed_over_time
from compiler.ir.program import Declared, History, Memory, Program, State, Tape
from msnn.data.dataset import BoolArray, Dataset
from msnn.data.reads import reads
from msnn.data.scored import scored_rows
from msnn.data.starts import Runs, reach
from msnn.errors import training
from msnn.simulation.rollout_plan import set_rollouts
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Findings

TRAIN, VALIDATION = "train", "val"


@dataclass(frozen=True, slots=True)
class Lesson:
    """Shorter rollouts to train on up to the end of epoch `until`."""

    until: int
    runs: Runs


@dataclass(frozen=True, slots=True, kw_only=True)
class StageData:
    """Rollouts and, where a whole record is simulated, the rows t that count."""

    train: Runs
    train_rows: Mapping[str, BoolArray] | None
    watched: Runs
    watched_rows: Mapping[str, BoolArray] | None
    watched_set: str
    lessons: tuple[Lesson, ...] = ()

    def in_epoch(self, epoch: int) -> Runs:
        """What is trained on after `epoch` complete epochs."""
        return next((each.runs for each in self.lessons if epoch < each.until), self.train)


def stage_data(plan: StagePlan, data: Dataset, findings: Findings) -> StageData | None:
    """What a stage runs over; None after a report that there is nothing."""
    rollout, span = plan.rollout, plan.span
    wanted_by = f"stage `{plan.name}`"
    train = set_rollouts(rollout, data, TRAIN, rollout.stride, wanted_by, span, findings)
    watched_set = VALIDATION if data.has(VALIDATION) else TRAIN
    watched = set_rollouts(rollout, data, watched_set, None, wanted_by, span, findings)
    lessons: list[Lesson] = []
    for phase in plan.phases:
        shorter = replace(rollout, horizon=phase.horizon)
        runs = set_rollouts(shorter, data, TRAIN, rollout.stride, wanted_by, span, Findings())
        if runs is not None:  # there are at least those of the whole horizon
            lessons.append(Lesson(phase.until, runs))
    if train is None or watched is None:
        return None
    _warn_of_fixed_starts(plan, data, train, findings)
    whole = rollout.horizon == "record"
    return StageData(
        train=train,
        train_rows=scored_rows(data, TRAIN, rollout.program) if whole else None,
        watched=watched,
        watched_rows=scored_rows(data, watched_set, rollout.program) if whole else None,
        watched_set=watched_set,
        lessons=tuple(lessons),
    )


def _warn_of_fixed_starts(plan: StagePlan, data: Dataset, runs: Runs, findings: Findings) -> None:
    """Rule R7: an `init` that reads no log is the value at the first row of a record.

    What says only of the run that it begins is right everywhere, and so is what only losses need:
    an integral in a loss is that of the rollout.
    """
    program = plan.rollout.program
    far = reach(program)
    first = np.array([record.start + far.back for record in data.records])
    if np.isin(runs.t0, first).all():
        return
    following = {state.name: state.next for state in program.states}
    outputs = [output.node for output in program.outputs]
    _, deployed = needed_over_time(program.step, following, outputs)
    for state in program.states:
        match state.origin:
            case Declared():
                fixed = True
            case Memory(of_run):
                fixed = not of_run and state.name in deployed
            case History() | Tape():
                fixed = False
            case _:
                assert_never(state.origin)
        if fixed and not _reads_log(program, state):
            of_call = isinstance(state.origin, Memory)
            findings.report(
                training.starts_elsewhere(plan.name, state.name, state.span, of_call=of_call)
            )


def _reads_log(program: Program, state: State) -> bool:
    return bool(reads(program.start, [state.start]))
