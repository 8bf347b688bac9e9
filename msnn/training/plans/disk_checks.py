"""Refuses stages that would need memory proportional to the number of rows for data on disk."""

from __future__ import annotations

from msnn.errors.disk_data import not_on_disk
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Findings


def check_on_disk(plan: StagePlan, findings: Findings) -> None:
    """Reports the reasons why a stage cannot run on data on disk."""
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
