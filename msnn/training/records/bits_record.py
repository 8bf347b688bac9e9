"""Describes in `run.json` what determines the bits of a run's weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from backends.native.compile_kernel import KernelDescription, kernel_description
from compiler.ir.program import Program
from msnn.training.plans.stage_plan import StagePlan

_LAPACK = "LAPACK of numpy and the processor"
_TORCH = "torch and the processor"
_NOT_FLOAT32 = "what made a kernel wrong here in float32, so that the stage ran in float64"


def bits_record(program: Program, plans: Sequence[StagePlan]) -> dict[str, Any]:
    """The kernel build, and if the weights are bitwise reproducible on other machines.

    `reproducible` is true if another compiler and another processor with fused multiply-add give
    the same bits. Otherwise `depends_on` names the cause per stage and per fitted layer.
    """
    native = any(plan.engine != "torch" for plan in plans)
    kernels = kernel_description() if native else None
    reasons = {fit.layer: _LAPACK for fit in program.fits}
    reasons |= {plan.name: reason for plan in plans if (reason := _depends_on(plan, kernels))}
    return {
        "reproducible": not reasons,
        "depends_on": reasons,
        "kernels": None if kernels is None else asdict(kernels),
    }


def as_it_ran(record: Mapping[str, Any], plan: StagePlan) -> dict[str, Any]:
    """The record after a stage fell back from its planned kernel."""
    reason = _TORCH if plan.engine == "torch" else _NOT_FLOAT32
    depends_on = {**record.get("depends_on", {}), plan.name: reason}
    return {**record, "reproducible": False, "depends_on": depends_on}


def _depends_on(plan: StagePlan, kernels: KernelDescription | None) -> str:
    """The cause besides spec and data that determines the bits of a stage; empty if there is
    none.
    """
    if plan.engine == "torch" or kernels is None:
        return _TORCH
    match plan.optimizer.steps_by:
        case "torch":
            return _TORCH
        case "LAPACK":
            return _LAPACK
        case "kernel" if kernels.fuses or plan.reproducible:
            return ""
        case "kernel":
            return "the processor: it has no fused multiply-add"
