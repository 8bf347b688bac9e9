"""Holds scaled values and derivatives of an optimal control problem along its horizon.

Stages, variables and the rows h of limits are those of `HorizonFunctions`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from msnn.features.control.problem.optimal_control.horizon import Array


@dataclass(frozen=True, slots=True)
class Values:
    """The values of one plan."""

    cost: float
    """σJ without penalties."""
    following: Array
    """F(x_k, u_k), (N, nx)."""
    rows: Array
    """h, (N+1, m)."""

    @property
    def are_finite(self) -> bool:
        """True if all values are finite; a square root of a negative value, say, is not."""
        return all(bool(np.isfinite(v).all()) for v in (self.cost, self.following, self.rows))


@dataclass(frozen=True, slots=True)
class Slopes:
    """First derivatives at one plan."""

    cost: Array
    """∂σJ/∂(x_k, u_k), (N+1, nx+nu)."""
    following: Array
    """∂F/∂(x_k, u_k), (N, nx, nx+nu)."""
    rows: Array
    """∂h/∂(x_k, u_k), (N+1, m, nx+nu)."""


@dataclass(frozen=True, slots=True)
class RowLimits:
    """The limits of the rows h: low and high end, ∓∞ where there is none, and the cost of excess.

    All (N+1, m) but for the costs, (m): ∞ for a row that is hard.
    """

    low: Array
    high: Array
    linear: Array
    quadratic: Array

    @property
    def are_numbers(self) -> bool:
        """True if no limit is NaN, which a computed limit may be even for finite references."""
        return not bool(np.any(np.isnan(self.low)) or np.any(np.isnan(self.high)))

    @property
    def can_be_met(self) -> bool:
        """True if each limit can be met: no lower one is +∞, no upper one −∞, none is NaN."""
        return bool(np.all(self.low < np.inf) and np.all(self.high > -np.inf))

    def without_unmet(self) -> RowLimits:
        """The limits without those that no value can meet."""
        low = np.where(self.low < np.inf, self.low, -np.inf)
        return replace(self, low=low, high=np.where(self.high > -np.inf, self.high, np.inf))
