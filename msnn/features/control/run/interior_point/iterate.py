"""Holds an iterate of the interior-point method and its Newton step."""

from __future__ import annotations

from dataclasses import dataclass

from msnn.features.control.problem.optimal_control.horizon import Array
from msnn.features.control.run.interior_point.horizon_values import Slopes, Values


@dataclass(frozen=True, slots=True)
class Iterate:
    """An iterate of the method, scaled: a plan, and values of its limits, low ones first.

    Slacks, multipliers, excesses and multipliers of excesses are (N+1, 2m).
    """

    states: Array
    controls: Array
    slacks: Array
    multipliers: Array
    excesses: Array
    excess_multipliers: Array


@dataclass(frozen=True, slots=True)
class Point:
    """An iterate with its derivatives and the residuals of its equations."""

    now: Iterate
    values: Values
    slopes: Slopes
    costates: Array
    gaps: Array
    """F(x_k, u_k) − x_{k+1}."""
    misfits: Array
    """p = c + v − t."""
    stationarity: float


@dataclass(frozen=True, slots=True)
class Direction:
    """A Newton step."""

    states: Array
    controls: Array
    slacks: Array
    multipliers: Array
    excesses: Array
    excess_multipliers: Array
