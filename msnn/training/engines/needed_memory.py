"""Estimates the memory that torch needs for the gradient of a batch."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from compiler.ir import ops
from compiler.ir.nodes import needed
from compiler.ir.program import Program
from msnn.data.starts import Runs
from msnn.errors.learning.stages import much_memory
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Diagnostic

_SHARE = 0.5
"""Fraction of the installed memory above which a warning precedes the stage."""


@dataclass(frozen=True, slots=True)
class Needed:
    """starts × steps × bytes of the largest batch."""

    starts: int
    steps: int
    step_bytes: int

    @property
    def total(self) -> int:
        return self.starts * self.steps * self.step_bytes


def memory_warnings(plan: StagePlan, runs: Runs, installed: int | None) -> tuple[Diagnostic, ...]:
    """Warns if a stage on torch needs more than half of the installed memory.

    Kernels cut long rollouts into pieces that fit (`KEPT_BYTES`), and least squares process the
    start rows in portions. torch keeps the values of every step until the gradient is computed.
    """
    needed = needed_by_torch(plan, runs)
    if installed is None or needed.total <= _SHARE * installed:
        return ()
    return (
        much_memory(
            stage=plan.name,
            starts=needed.starts,
            steps=needed.steps,
            step_bytes=needed.step_bytes,
            installed=installed,
            span=plan.span,
        ),
    )


def needed_by_torch(plan: StagePlan, runs: Runs) -> Needed:
    """Estimates the values of all operations of a step, for each start row and step of a batch.

    Views, such as windows and reshapes, and values that depend on parameters only are not counted.
    The measured memory is 0.5 to 0.9 of this, more for longer rollouts.
    """
    starts = len(runs) if plan.batch is None else min(plan.batch, len(runs))
    steps = int(np.max(runs.steps, initial=0))
    size = np.dtype(plan.dtype).itemsize
    return Needed(starts, steps, size * _values(plan.program))


def installed_memory() -> int | None:
    """Installed memory in bytes; None if the system does not report it."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return None


def _values(program: Program) -> int:
    """Number of elements that a step computes for each start row: elementwise values, windows,
    sums.
    """
    graph = program.step
    wanted = [state.next for state in program.states]
    wanted += [loss.prediction for loss in program.losses]
    live = needed(graph, wanted)
    fixed: list[bool] = []
    for _, node in graph:
        match node.op:
            case ops.Constant() | ops.ReadParameter():
                fixed.append(True)
            case ops.Leaf() | ops.Window():
                fixed.append(False)
            case _:
                fixed.append(all(fixed[arg] for arg in node.args))
    return sum(
        node.type.size
        for index, (_, node) in enumerate(graph)
        if live[index] and not fixed[index] and not isinstance(node.op, ops.Leaf | ops.Structure)
    )
