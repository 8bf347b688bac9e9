"""Says what a loaded export can do: a free run, and where it shows its states, more of it.

It is all that comparing, and running data through an export, ask of a target.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from compiler.jacobian.matrices import Jacobian
from msnn.agreement.judging.judgement import Arrays, Beginning
from spec_schema.late_dataclass import dataclass

Start: TypeAlias = Callable[[Beginning], Arrays]
"""The states before the first step, (1, *shape) each."""
Run: TypeAlias = Callable[[Beginning, Arrays, int], Arrays]
"""Outputs (steps, *shape) of a run from a beginning, for inputs (steps, *shape)."""
Step: TypeAlias = Callable[[Arrays, Arrays, int], tuple[Arrays, Arrays]]
"""Outputs and next states of steps side by side, for inputs and states; all (steps, *shape)."""


@dataclass(frozen=True, slots=True)
class ExportedSlopes:
    """The Jacobian that an export computes: what its matrices are, and their values."""

    jacobian: Jacobian
    at: Callable[[Arrays, Arrays, int], Arrays]
    """Matrices (steps, rows, columns) by name, for inputs and states (steps, *shape)."""


def no_slopes() -> ExportedSlopes | None:
    """The slopes of an export without a Jacobian, or of a vast one."""
    return None


@dataclass(frozen=True, slots=True)
class Loaded:
    """An export that was loaded from its files, without the program that they came from."""

    run: Run
    start: Start | None = None
    """None where states are not seen."""
    step: Step | None = None
    """None where states cannot be set: such a target can promise bits only."""
    slopes: Callable[[], ExportedSlopes | None] = no_slopes
    """Asked for where they are compared: to derive a step takes longer than to run it."""


def loaded_by_steps(
    start: Start, step: Step, slopes: Callable[[], ExportedSlopes | None] = no_slopes
) -> Loaded:
    """An export with explicit states, which is run step by step."""

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
    """Arrays of single steps as arrays (steps, *shape)."""
    return {name: np.stack([step[name] for step in steps]) for name in steps[0]}
