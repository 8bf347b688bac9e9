"""Describes which slices of learned arrays are omitted from an export."""

from __future__ import annotations

from msnn.exports.target import AnyPlan


def left_out(plan: AnyPlan) -> str:
    """One line; empty if nothing is omitted."""
    if not plan.cuts:
        return ""
    kept = ", ".join(f"{len(cut.kept)} of {cut.size} in {cut.parameter}" for cut in plan.cuts)
    return f"without slices that are 0: kept are {kept}"
