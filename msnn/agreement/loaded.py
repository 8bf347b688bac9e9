"""Defines what a loaded export can do: simulate, and execute single steps if states are visible.

This interface is sufficient to compare a target and to run data through it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from compiler.jacobian.matrices import Jacobian
from msnn.agreement.judging.judgement import Arrays, Beginning
from spec_schema.late_dataclass import dataclass

Start: TypeAlias = Callable[[Beginning], Arrays]
"""Computes the initial states, (1, *shape) each."""
Run: TypeAlias = Callable[[Beginning, Arrays, int], Arrays]
"""Simulates inputs (steps, *shape) from a beginning; returns outputs (steps, *shape)."""
Step: TypeAlias = Callable[[Arrays, Arrays, int], tuple[Arrays, Arrays]]
"""Executes independent single steps: inputs and states to outputs and next states, (steps,
*shape).
"""


@dataclass(frozen=True, slots=True)
class ExportedSlopes:
    """The Jacobian that an export computes: the structure of its matrices, and their values."""

    jacobian: Jacobian
    at: Callable[[Arrays, Arrays, int], Arrays]
    """Matrices (steps, rows, columns) by name, for inputs and states (steps, *shape)."""


def no_slopes() -> ExportedSlopes | None:
    """None: the export has no Jacobian, or a very large one."""
    return None


@dataclass(frozen=True, slots=True)
class Loaded:
    """An export loaded from its files, independent of the original program."""

    run: Run
    start: Start | None = None
    """None if states are not visible."""
    step: Step | None = None
    """None if states cannot be set; such a target can only promise identical bits."""
    slopes: Callable[[], ExportedSlopes | None] = no_slopes
    """Called only if Jacobians are compared, because they take longer than a step."""


def loaded_by_steps(
    start: Start, step: Step, slopes: Callable[[], ExportedSlopes | None] = no_slopes
) -> Loaded:
    """An export with explicit states, simulated by single steps."""

    def run(beginning: Beginning, inputs: Arrays, steps: int) -> Arrays:
        states = start(beginning)
        found: list[Arrays] = []
        for k in range(steps):
            given = {name: values[k : k + 1] for name, values in inputs.items()}
            outputs, states = step(given, states, 1)
            found.append(outputs)
        return {name: np.concatenate([one[name] for one in found]) for name in found[0]}

    return Loaded(run, start, step, slopes)


def stacked(steps: list[Arrays]) -> Arrays:
    """Stacks arrays of single steps to arrays (steps, *shape)."""
    return {name: np.stack([step[name] for step in steps]) for name in steps[0]}
