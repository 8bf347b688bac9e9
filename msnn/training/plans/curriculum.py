"""Plans the shorter horizons of a curriculum, and the last epoch of each."""

from __future__ import annotations

from compiler.ir.program import Program
from msnn.errors.learning import stages as errors
from msnn.simulation.durations import samples
from msnn.simulation.rollout_plan import RolloutPlan
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.training import Rollout


@dataclass(frozen=True, slots=True)
class Phase:
    """Until the end of epoch `until`, rollouts have `horizon` steps."""

    until: int
    horizon: int


def plan_curriculum(
    program: Program, rollout: Rollout, plan: RolloutPlan, epochs: int, findings: Findings
) -> tuple[Phase, ...]:
    """The phases before the full horizon; errors go to `findings`."""
    if rollout.curriculum is None:
        return ()
    if plan.horizon == "record":
        problem = "`horizon: record` runs each record once, from its beginning to its end"
        findings.report(errors.misfitting_curriculum(problem, rollout.curriculum.span))
        return ()
    phases: list[Phase] = []
    for lesson in rollout.curriculum.lessons:
        horizon = samples(lesson.horizon, program.sample_time, findings)
        if horizon is None:
            continue
        problem = _problem(Phase(lesson.until, horizon), phases, plan, epochs)
        if problem is not None:
            findings.report(errors.misfitting_curriculum(problem, lesson.span))
        phases.append(Phase(lesson.until, horizon))
    return tuple(phases)


def _problem(phase: Phase, before: list[Phase], plan: RolloutPlan, epochs: int) -> str | None:
    if phase.until >= epochs:
        return f"epoch {phase.until} is not before the last one, {epochs}"
    if before and phase.until <= before[-1].until:
        return f"epoch {phase.until} does not come after epoch {before[-1].until}"
    if before and phase.horizon <= before[-1].horizon:
        return f"{phase.horizon} evaluations are not more than the {before[-1].horizon} before"
    if isinstance(plan.horizon, int) and phase.horizon >= plan.horizon:
        return f"{phase.horizon} evaluations are not fewer than the horizon, {plan.horizon}"
    if phase.horizon <= plan.skip:
        return f"{plan.skipped_by} {plan.skip} leaves nothing of {phase.horizon} evaluations"
    return None
