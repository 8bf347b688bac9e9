"""Holds what the functions of an optimal control problem give along a horizon, scaled.

Stages, variables and the rows h of limits are those of `HorizonFunctions`.
"""

from __future__ import annotations

from dataclasses import dataclass

from compiler.optimal_control.horizon import Array


@dataclass(frozen=True, slots=True)
class Values:
    """Of one plan."""

    cost: float
    """J without penalties."""
    following: Array
    """F(x_k, u_k), (N, nx)."""
    rows: Array
    """h, (N+1, m)."""


@dataclass(frozen=True, slots=True)
class Slopes:
    """First derivatives at one plan."""

    cost: Array
    """∂J/∂(x_k, u_k), (N+1, nx+nu)."""
    following: Array
    """∂F/∂(x_k, u_k), (N, nx, nx+nu)."""
    rows: Array
    """∂h/∂(x_k, u_k), (N+1, m, nx+nu)."""


@dataclass(frozen=True, slots=True)
class RowLimits:
    """Of the rows h: where they begin and end, ∓∞ where nothing limits them, and what excess costs.

    All (N+1, m) but for the costs, (m): ∞ for a row that is hard.
    """

    low: Array
    high: Array
    linear: Array
    quadratic: Array
