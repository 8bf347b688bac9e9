"""Says what the bits of a run's weights depend on, for `run.json`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from backends.native.kernel_description import KernelDescription, kernel_description
from compiler.ir.program import Program
from msnn.training.plans.stage_plan import StagePlan

_LAPACK = "LAPACK of numpy and the processor"


def bits_record(program: Program, plans: Sequence[StagePlan]) -> dict[str, Any]:
    """The build of kernels here, and whether the weights have these bits on other machines too.

    Bits are `reproducible` where another compiler and another processor with a fused multiply-add
    find the same. Else `depends_on` says of stages, and of layers that are fitted, what decides.
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


def _depends_on(plan: StagePlan, kernels: KernelDescription | None) -> str:
    """The things besides spec and data that decide the bits of a stage; empty if none does."""
    if plan.engine == "torch" or kernels is None:
        return "torch and the processor"
    match plan.optimizer.steps_by:
        case "torch":
            return "torch and the processor"
        case "LAPACK":
            return _LAPACK
        case "kernel" if kernels.fuses or plan.reproducible:
            return ""
        case "kernel":
            return "the processor: it has no fused multiply-add"
