"""Defines the solving method of a controller, and the solution that a controller returns."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, Protocol

from msnn.features.control.problem.horizon import Array, Given, Multipliers, Plan
from msnn.features.control.run.control_range import ControlRange
from msnn.features.control.run.interior_point.horizon_functions import Values


class Status(IntEnum):
    """The outcome of a solve; with the first two the control is that of a new plan."""

    SOLVED = 0
    """The residual is at most the tolerance."""
    CAPPED = 1
    """Iterations ran out: limits hold, the residual is told."""
    INFEASIBLE = 2
    """No plan within hard limits was found: the last control, inside its own limits; of two that
    contradict each other the upper one is kept."""
    INPUT_NOT_FINITE = 3
    """A measurement, disturbance or reference is not finite, or a limit NaN: the last control,
    inside those of its limits that are numbers."""
    NOT_INITIALISED = 4
    """Some state was never given: as above."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """The result of a solve: the control to apply at t, the plan that begins with it, and its
    accuracy.
    """

    status: Status
    control: dict[str, Array]
    """By name, within its limits whatever the status is."""
    controls: dict[str, Array]
    """The plan u_0 … u_{N−1} by name, (N, *shape)."""
    states: dict[str, Array]
    """x_0 … x_N by name, (N+1, *shape)."""
    cost: float
    """J, penalties included; NaN where there is no plan."""
    residual: float
    """Largest of the optimality conditions, as `Judge` has them; ∞ without a plan."""
    violation: float
    """Of hard limits, relative to their scales."""
    excess: float
    """Largest violation of soft limits, relative to their scales."""
    iterations: int
    given: Given | None
    """What it was solved for, for `kkt_residual`; None where nothing was solved."""
    plan: Plan | None
    multipliers: Multipliers | None


Solver = Literal["c", "python"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """The result of a method; `status` is SOLVED, CAPPED or INFEASIBLE."""

    status: Status
    plan: Plan
    values: Values
    """Cost, next states and rows of the plan."""
    multipliers: Multipliers
    residual: float
    violation: float
    """Of hard limits, scaled."""
    iterations: int


class Method(Protocol):
    """A solver of one problem that starts each solve from the plan of the previous one."""

    @property
    def name(self) -> Solver:
        """The solver's name."""
        ...

    def forget(self, applied: Array | None) -> None:
        """Deletes the plan; `applied` are the controls (nu) that the plant receives now, None if
        unknown.
        """
        ...

    def solve(self, given: Given, allowed: ControlRange, resting: Array) -> Found:
        """Solves for the values `given` with controls within `allowed`; without a plan, it starts
        from the controls `resting` (nu), held along the horizon.
        """
        ...
