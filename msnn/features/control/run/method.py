"""Says what a controller asks of whoever solves its problems."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from msnn.features.control.problem.optimal_control.horizon import Array, Given, Multipliers, Plan
from msnn.features.control.run.control_range import ControlRange
from msnn.features.control.run.interior_point.horizon_values import Values
from msnn.features.control.run.solution import Status

Solver = Literal["c", "python"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """The end of a method; `status` is one of the first three."""

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
    """A method that begins each solve at the plan of the one before."""

    @property
    def name(self) -> Solver:
        """The solver's name."""
        ...

    def forget(self, applied: Array | None) -> None:
        """Begins anew, from the controls that are applied where they are known."""
        ...

    def solve(self, given: Given, allowed: ControlRange, resting: Array) -> Found:
        """Solves; `resting` are the controls of a first plan where there is no other."""
        ...
