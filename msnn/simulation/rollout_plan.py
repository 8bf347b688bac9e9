"""Plans rollouts: horizons in samples, closed loops, start rows in a set's episodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from compiler.differentiation.estimated_starts import (
    estimated_states,
    evaluations_that_decide,
    with_read_starts,
)
from compiler.ir.nodes import Extent
from compiler.ir.program import Program, Role
from compiler.lowering.context import LoweringFailed, Sampling
from compiler.passes.close_loop import LoopError, close_loop
from msnn.data.dataset import BoolArray, Dataset, IntArray
from msnn.data.rollout_rows import (
    Horizon,
    Reach,
    Runs,
    has_unmeasured,
    reach,
    reads,
    rollouts,
    scored_rows,
)
from msnn.errors.data import rows as data_rows
from msnn.errors.learning import training as errors
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.tree import Length
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.training import Rollout


@dataclass(frozen=True, slots=True)
class PlannedStarts:
    """How the initial states of rollouts are estimated: the program, and the steps that determine
    them.
    """

    program: Program
    """The closed-loop program before it reads the estimates."""
    over: int | None
    """Number of these steps; None for all scored steps of a run."""
    skip: int
    """Steps that other keys exclude from scoring."""
    as_trained: bool = False
    """True if all runs begin at the initial states of the training."""

    @property
    def first_to_decide(self) -> int:
        """The first step used for the estimate."""
        return self.skip if self.over is None else 0


@dataclass(frozen=True, slots=True, kw_only=True)
class RolloutPlan:
    """The rollouts of a stage or a metric: horizon, stride, skipped steps, and the closed-loop
    program.
    """

    program: Program
    horizon: Horizon
    stride: int
    skip: int
    """Unscored steps at the beginning of each run, including the warm-up."""
    closed: tuple[str, ...]
    skipped_by: str = "skip"
    """The key that `skip` comes from."""
    warm_up: int = 0
    """Steps at the beginning of each run in which closed signals are read from the data."""
    skip_rows: int = 0
    """Unscored rows at the beginning of each recording."""
    starts: PlannedStarts | None = None
    """States with estimated initial values; None if there are none."""

    @property
    def fed_back(self) -> tuple[str, ...]:
        """The input signals that read a prediction of the model instead of the data.

        With horizon 1, only those predicted for the same row do.
        """
        if self.horizon != 1:
            return self.closed
        predicted = (output.predicts for output in self.program.outputs)
        same = {one.signal for one in predicted if one is not None and one.ahead == 0}
        return tuple(name for name in self.closed if name in same)

    @property
    def reading(self) -> Program:
        """The program that determines which rows a rollout needs; it includes those of estimated
        initial states.
        """
        return self.program if self.starts is None else self.starts.program


def plan_rollout(
    program: Program,
    rollout: Rollout | None,
    stride: int | None,
    findings: Findings,
    skip_rows: Length | None = None,
    span: Span | None = None,
) -> RolloutPlan | None:
    """Resolves the `rollout:` of a stage or metric: lengths in samples, closed loops; errors go to
    `findings`.

    `stride` None means the horizon. None after an error.
    """
    unscored = 0 if skip_rows is None else samples(skip_rows, program.sample_time, findings)
    if unscored is None:
        return None
    if rollout is None:
        one = RolloutPlan(
            program=program, horizon=1, stride=1, skip=0, closed=(), skip_rows=unscored
        )
        return _with_found_starts(one, span, findings)
    horizon: Horizon | None
    if isinstance(rollout.horizon, str):
        horizon = rollout.horizon
    else:
        horizon = samples(rollout.horizon, program.sample_time, findings)
    length = horizon if isinstance(horizon, int) else 1
    given = stride or length
    if rollout.stride is not None:
        given = samples(rollout.stride, program.sample_time, findings)
    skip = 0 if rollout.skip is None else samples(rollout.skip, program.sample_time, findings)
    warm_up = 0
    if rollout.warm_up is not None:
        warm_up = samples(rollout.warm_up, program.sample_time, findings)
    closed = closed_signals(program, rollout)
    try:
        looped = close_loop(program, closed, warm_up or 0)
    except LoopError as error:
        findings.report(errors.cannot_close(error.signal, str(error), rollout.place.value))
        return None
    # after the loop is closed: both kinds of mistakes are told at once
    if horizon is None or given is None or skip is None or warm_up is None:
        return None
    if warm_up and not closed:
        findings.report(errors.warms_nothing(rollout.place.value))
    # a closed signal that is still read from the log shows nothing of the model
    # they run side by side from the start: the longer one decides
    key, unscored_steps = max(("skip", skip), ("warm_up", warm_up), key=lambda one: one[1])
    plan = RolloutPlan(
        program=looped,
        horizon=horizon,
        stride=max(given, 1),
        skip=unscored_steps,
        closed=closed,
        skipped_by=key,
        warm_up=warm_up,
        skip_rows=unscored,
    )
    return _with_found_starts(plan, rollout.place.value, findings)


def default_rollout(program: Program) -> RolloutPlan:
    """One step per rollout; whole recordings if initial states must be estimated."""
    plan = RolloutPlan(program=program, horizon=1, stride=1, skip=0, closed=())
    if estimated_states(program):
        # a start that is fitted needs samples to be fitted to: one step has none
        plan = replace(plan, horizon="record")
    found = _with_found_starts(plan, None, Findings())
    assert found is not None, "a record has room for starts"
    return found


def free_rollout(program: Program) -> RolloutPlan:
    """The plan of a simulation of whole recordings, with all predicted inputs fed back.

    Raises LoopError if a loop cannot be closed.
    """
    closed = predicted_inputs(program)
    looped = close_loop(program, closed)
    plan = RolloutPlan(program=looped, horizon="record", stride=1, skip=0, closed=closed)
    found = _with_found_starts(plan, None, Findings())
    assert found is not None, "a record has room for starts"
    return found


def predicted_inputs(program: Program) -> tuple[str, ...]:
    """The inputs that outputs predict, in the order of the outputs."""
    predicted = [out.predicts.signal for out in program.outputs if out.predicts is not None]
    inputs = {signal.name for signal in program.signals if signal.role is Role.INPUT}
    return tuple(dict.fromkeys(name for name in predicted if name in inputs))


def _with_found_starts(
    plan: RolloutPlan, span: Span | None, findings: Findings
) -> RolloutPlan | None:
    """The plan with the steps that estimates leave unscored; None if no step remains."""
    estimated = estimated_states(plan.program)
    if estimated:
        over = evaluations_that_decide(estimated)
        starts = PlannedStarts(plan.program, over, plan.skip)
        # initial states become series: estimated outside the program and read like data
        program = with_read_starts(plan.program)
        plan = replace(plan, program=program, starts=starts)
        if over is not None and over > plan.skip:
            plan = replace(plan, skip=over, skipped_by=f"the fit of `{estimated[0].name}` over")
    # of whole records the length is known only with the data
    if isinstance(plan.horizon, int) and plan.skip >= plan.horizon:
        found = errors.skips_everything(plan.skipped_by, plan.skip, plan.horizon, span)
        findings.report(found)
        return None
    return plan


def closed_signals(program: Program, rollout: Rollout) -> tuple[str, ...]:
    """The inputs that a rollout feeds back: those of `close`, by default all predicted inputs."""
    if rollout.close is not None:
        return tuple(name.value for name in rollout.close)
    return predicted_inputs(program)


def set_rollouts(
    plan: RolloutPlan,
    data: Dataset,
    name: str,
    stride: int | None,
    wanted_by: str,
    span: Span | None,
    findings: Findings,
    also: Extent | None = None,
) -> Runs | None:
    """The rollouts of a plan in the set `name` (`train`, …), as start rows and numbers of steps.

    `stride` None visits each sample once (rule R2). `also` are further samples relative to t that
    must exist. `wanted_by` and `span` are for messages. None after reporting errors.
    """
    if not data.has(name):
        known = [known for known in data.sets if data.has(known)]
        findings.report(data_rows.no_rows_in_set(name, known, span))
        return None
    far = reach(plan.reading, also)
    # `record` runs through rows of all sets, so that states have settled, and scores those of one
    # (R10)
    episodes = data.stretches() if plan.horizon == "record" else data.episodes(name)
    once = isinstance(plan.horizon, int) and stride is None
    # a stride of the horizon visits each row once; `rest` lets a shorter last one take what is left
    step = plan.horizon if once and isinstance(plan.horizon, int) else stride or 1
    runs = rollouts(episodes, far, plan.horizon, step, rest=once)
    # whole records and the rest of an episode need room for one evaluation
    needed = far.rows(plan.horizon if isinstance(plan.horizon, int) and not once else 1)
    if runs.skipped and len(runs):
        total, files = len(episodes), files_skipped(data, episodes, runs)
        findings.report(data_rows.episodes_skipped(runs.skipped, total, needed, wanted_by, files))
    planned = runs
    runs = _with_known_starts(plan, data, runs)
    if isinstance(plan.horizon, int) and len(runs) < len(planned):
        left_out = planned.take(np.flatnonzero(~np.isin(planned.t0, runs.t0)))
        # those that visit each row once, and others if nothing is left to score
        if (once or not _reaches_a_value(plan.program, data, runs)) and _reaches_a_value(
            plan.program, data, left_out
        ):
            better = _horizon_of_known_starts(plan, data, episodes, far)
            findings.report(
                data_rows.starts_not_measured(
                    wanted_by=wanted_by,
                    signals=start_signals(plan),
                    left_out=len(left_out),
                    total=len(planned),
                    horizon=plan.horizon,
                    better=better,
                    span=span,
                )
            )
    if not len(runs):
        findings.report(data_rows.episodes_too_short(name, runs.longest, needed, wanted_by, span))
        return None
    scored = _with_scored_rows(plan, data, runs, far.ahead)
    if not len(scored):
        longest = max(record.stop - record.start for record in data.records)
        findings.report(data_rows.rows_all_skipped(plan.skip_rows, longest, wanted_by, span))
        return None
    most = int(scored.steps.max())
    if plan.skip >= most:
        findings.report(errors.skips_everything(plan.skipped_by, plan.skip, most, span))
        return None
    return scored


def counted_rows(plan: RolloutPlan, data: Dataset, name: str) -> Mapping[str, BoolArray] | None:
    """For every loss, the mask (rows,) of rows that are scored in a set; None if all are."""
    whole = plan.horizon == "record"
    if not whole and not plan.skip_rows and not has_unmeasured(data, plan.program):
        return None
    return scored_rows(data, name if whole else None, plan.program, plan.skip_rows)


def score_some(runs: Runs, rows: Mapping[str, BoolArray] | None) -> BoolArray:
    """The mask of rollouts in which at least one loss has a scored row; `rows` are masks
    per loss.
    """
    if rows is None:
        return np.ones(len(runs), np.bool_)
    before = np.concatenate([[0], np.cumsum(np.any([*rows.values()], axis=0))])
    return before[runs.t0 + runs.steps] > before[runs.t0]


def _with_scored_rows(plan: RolloutPlan, data: Dataset, runs: Runs, ahead: int) -> Runs:
    """The rollouts without those that end before the first scored row of their recording."""
    if not plan.skip_rows:
        return runs
    begins = np.array([record.start for record in data.records])
    begin = begins[np.searchsorted(begins, runs.t0, side="right") - 1]
    reached = runs.t0 + runs.steps + ahead > begin + plan.skip_rows
    return runs if reached.all() else runs.take(np.flatnonzero(reached))


def files_skipped(data: Dataset, episodes: IntArray, runs: Runs) -> list[str]:
    """The files with an episode in which no rollout starts."""
    # as many rollouts begin before an episode as before its end: none begins in it
    first, after = (np.searchsorted(runs.t0, episodes[:, end]) for end in (0, 1))
    starts = episodes[first == after, 0]
    return list(
        dict.fromkeys(
            record.file
            for record in data.records
            if ((record.start <= starts) & (starts < record.stop)).any()
        )
    )


def start_signals(plan: RolloutPlan) -> tuple[str, ...]:
    """The signals from which the initial states of a plan's rollouts are read."""
    program = plan.reading
    return tuple(reads(program.start, [state.start for state in program.states]))


def _reaches_a_value(program: Program, data: Dataset, runs: Runs) -> bool:
    """True if a rollout predicts a row with a measured value."""
    for output in program.outputs:
        if output.predicts is None or not len(runs) or output.predicts.signal not in data.series:
            continue
        values = data.measured_values(output.predicts.signal)
        known = np.isfinite(values.reshape(data.rows, -1)).any(axis=1)
        before = np.concatenate([[0], np.cumsum(known)])
        first = np.clip(runs.t0 + output.predicts.ahead, 0, data.rows)
        if (before[np.clip(first + runs.steps, 0, data.rows)] > before[first]).any():
            return True
    return False


def _horizon_of_known_starts(
    plan: RolloutPlan, data: Dataset, episodes: IntArray, far: Reach
) -> int | None:
    """The next longer horizon with which every rollout with targets has a measured start.

    None if samples are unevenly spaced and there is no such horizon.
    """
    assert isinstance(plan.horizon, int)
    every_row = rollouts(episodes, far, 1, 1)
    known = every_row.t0[_steps_to_start(plan.reading, data, every_row) == 0]
    if len(known) < 2:
        return None
    apart = int(np.median(np.diff(known)))
    better = -(-plan.horizon // apart) * apart
    runs = rollouts(episodes, far, better, better, rest=True)
    started = _steps_to_start(plan.reading, data, runs) == 0
    others = runs.take(np.flatnonzero(~started))
    return None if _reaches_a_value(plan.program, data, others) else better


def _with_known_starts(plan: RolloutPlan, data: Dataset, runs: Runs) -> Runs:
    """The rollouts without those whose initial states would be read from missing samples.

    Rollouts over whole episodes begin later instead, at the first available samples.
    """
    later = _steps_to_start(plan.reading, data, runs)
    if isinstance(plan.horizon, str):
        return begun_where_known(plan.reading, data, runs.take(np.flatnonzero(later < runs.steps)))
    return runs if not later.any() else runs.take(np.flatnonzero(later == 0))


def begun_where_known(program: Program, data: Dataset, runs: Runs) -> Runs:
    """The same runs, each beginning where its initial states are measured.

    A run without such a row is unchanged. The last rows of runs do not change.
    """
    later = _steps_to_start(program, data, runs)
    later = np.where(later < runs.steps, later, 0)
    return replace(runs, t0=runs.t0 + later, steps=runs.steps - later)


def _steps_to_start(program: Program, data: Dataset, runs: Runs) -> IntArray:
    """Steps after the first one until all samples for a run's initial states are available.

    If they never are, the result is at least the number of its steps.
    """
    far = reach(program)
    known = np.ones(data.rows, dtype=np.bool_)
    for name, extent in reads(program.start, [s.start for s in program.states]).items():
        # targets may be missing in rows that are usable; a start that reads one would be NaN
        missing = np.asarray(np.isnan(data.series[name].reshape(data.rows, -1)).any(axis=1))
        if missing.any():
            for offset in range(extent.first, extent.last + 1):
                # no rollout starts where this leaves the data
                known &= ~missing[np.clip(np.arange(data.rows) + offset, 0, data.rows - 1)]
    if known.all():
        return np.broadcast_to(np.int64(0), len(runs))
    never = 2 * data.rows
    rows = np.append(np.flatnonzero(known), never)
    later = rows[np.searchsorted(rows, runs.t0)] - runs.t0
    # a start may look farther ahead than the steps do
    room = runs.steps - max(far.start_ahead - far.ahead, 0)
    return np.where((later > 0) & (later >= room), never, later)


def samples(length: Length, sample_time: float | None, findings: Findings) -> int | None:
    """The number of samples of a length; None after reporting a duration that is no whole number of
    them.
    """
    try:
        return Sampling(sample_time, findings).samples(length)
    # the compiler's own count has told why: 0.25 s is no whole number of samples of 0.1 s
    except LoweringFailed:
        return None
