"""The rollouts of a stage: those it trains on, and those that decide which weights are best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from compiler.program import Declared, Program, State
from msnn.data.dataset import BoolArray, Dataset
from msnn.data.reads import reads
from msnn.data.scored import scored_rows
from msnn.data.starts import Reach, Runs, reach, rollouts
from msnn.training.stage_plan import RolloutPlan, StagePlan
from spec_schema.diagnostics import Findings
from spec_schema.errors import data_files, training
from spec_schema.source import Span

TRAIN, VALIDATION = "train", "val"


@dataclass(frozen=True, slots=True)
class StageData:
    """Rollouts and, where a whole record is simulated, the rows t that count."""

    train: Runs
    train_rows: Mapping[str, BoolArray] | None
    watched: Runs
    watched_rows: Mapping[str, BoolArray] | None
    watched_set: str


def stage_data(plan: StagePlan, data: Dataset, findings: Findings) -> StageData | None:
    """What a stage runs over; None after a report that there is nothing."""
    rollout, span = plan.rollout, plan.span
    wanted_by = f"stage `{plan.name}`"
    train = set_rollouts(rollout, data, TRAIN, rollout.stride, wanted_by, span, findings)
    watched_set = VALIDATION if data.has(VALIDATION) else TRAIN
    watched = set_rollouts(rollout, data, watched_set, None, wanted_by, span, findings)
    if train is None or watched is None:
        return None
    _warn_of_fixed_starts(plan, data, train, findings)
    whole = rollout.horizon == "record"
    return StageData(
        train,
        scored_rows(data, TRAIN, rollout.program) if whole else None,
        watched,
        scored_rows(data, watched_set, rollout.program) if whole else None,
        watched_set,
    )


def set_rollouts(
    plan: RolloutPlan,
    data: Dataset,
    name: str,
    stride: int | None,
    wanted_by: str,
    span: Span | None,
    findings: Findings,
) -> Runs | None:
    """The rollouts of a plan in one set; `stride` None visits each sample once (rule R2)."""
    if not data.has(name):
        known = [known for known in data.sets if data.has(known)]
        findings.report(data_files.no_rows_in_set(name, known, span))
        return None
    far = reach(plan.program)
    episodes = data.stretches() if plan.horizon == "record" else data.episodes(name)
    once = isinstance(plan.horizon, int) and stride is None
    step = plan.horizon if once and isinstance(plan.horizon, int) else stride or 1
    runs = rollouts(episodes, far, plan.horizon, step, rest=once)
    needed = far.rows(plan.horizon if isinstance(plan.horizon, int) and not once else 1)
    if runs.skipped and len(runs):
        findings.report(data_files.episodes_skipped(runs.skipped, len(episodes), needed, wanted_by))
    runs = _with_known_starts(plan.program, data, runs)
    if not len(runs):
        findings.report(data_files.episodes_too_short(name, runs.longest, needed, wanted_by, span))
        return None
    return runs


def _with_known_starts(program: Program, data: Dataset, runs: Runs) -> Runs:
    """Without the rollouts whose first states would come from missing samples."""
    known = np.ones(len(runs), dtype=np.bool_)
    for name, extent in reads(program.start, [s.start for s in program.states]).items():
        missing = np.asarray(np.isnan(data.series[name].reshape(data.rows, -1)).any(axis=1))
        if missing.any():
            for offset in range(extent.first, extent.last + 1):
                known &= ~missing[runs.t0 + offset]
    return runs if known.all() else runs.take(np.flatnonzero(known))


def _warn_of_fixed_starts(plan: StagePlan, data: Dataset, runs: Runs, findings: Findings) -> None:
    """Rule R7: an `init` that reads no log is the value at the first row of a record."""
    program = plan.rollout.program
    far: Reach = reach(program)
    first = np.array([record.start + far.back for record in data.records])
    if np.isin(runs.t0, first).all():
        return
    for state in program.states:
        if isinstance(state.origin, Declared) and not _reads_log(program, state):
            findings.report(training.starts_elsewhere(plan.name, state.name, state.span))


def _reads_log(program: Program, state: State) -> bool:
    return bool(reads(program.start, [state.start]))
