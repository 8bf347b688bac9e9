"""Says which slices of learned arrays an export is written without."""

from __future__ import annotations

from msnn.exports.target import AnyPlan


def left_out(plan: AnyPlan) -> str:
    """One line; empty where everything is there."""
    if not plan.cuts:
        return ""
    kept = ", ".join(f"{len(cut.kept)} of {cut.size} in {cut.parameter}" for cut in plan.cuts)
    return f"without slices that are 0: kept are {kept}"
