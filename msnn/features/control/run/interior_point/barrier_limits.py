"""Holds the limits of one problem in the form of an interior-point method: c(w) ≥ 0."""

from __future__ import annotations

import numpy as np

from msnn.features.control.problem.optimal_control.horizon import Array
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.interior_point.horizon_values import RowLimits, Values

ROUNDING = float(np.finfo(np.float64).eps) / 2
"""The largest error of a rounded number, by its size."""

_NARROW = 1e-7
"""Limits that leave less than this, scaled, are set apart so that there is an inside …"""
_APART = 1e-8
"""… by this."""


class BarrierLimits:
    """The limits of the rows h, (N+1, 2m): c = h − low, then c = high − h."""

    def __init__(self, functions: HorizonFunctions, limits: RowLimits) -> None:
        whole = np.concatenate([limits.low, limits.high], axis=1)
        ends = np.concatenate(_with_inside(limits), axis=1)
        self.signs = np.repeat([1.0, -1.0], limits.low.shape[1])
        # ∞ − ∞ would be NaN: what limits nothing has the end 0 and is not active
        self.active = np.isfinite(ends)
        self.ends = np.where(self.active, ends, 0.0)
        # controls are put within their limits at last, so that those of the method are theirs
        nu, size = functions.controls, int(limits.low.shape[1])
        is_control = np.array([number % size < nu for number in range(2 * size)], np.bool_)
        self._judged_ends = np.where(is_control, self.ends, np.where(self.active, whole, 0.0))
        linear, quadratic = (np.tile(w, 2) for w in (limits.linear, limits.quadratic))
        # an infinite cost of excess is what makes a limit hard
        self.soft = self.active & np.isfinite(linear)
        self.linear = np.where(self.soft, linear, 0.0)
        self.quadratic = np.where(self.soft, quadratic, 0.0)

    def distances(self, values: Values, *, judged: bool = False) -> Array:
        """c of every limit, 0 where there is none; `judged` by the limits as they are given."""
        both = np.concatenate([values.rows, values.rows], axis=1)
        ends = self._judged_ends if judged else self.ends
        return np.where(self.active, self.signs * (both - ends), 0.0)

    def by_row(self, multipliers: Array) -> Array:
        """The factor of each row's gradient: the high limit's multiplier minus the low one's."""
        size = len(self.signs) // 2
        signed = -self.signs * multipliers
        return signed[:, :size] + signed[:, size:]

    def violation(self, values: Values) -> float:
        """The largest of hard limits, as they are given."""
        distance = self.distances(values, judged=True)
        hard = np.where(self.active & ~self.soft, -distance, 0.0)
        return float(np.max(hard, initial=0.0))

    def rounding(self, values: Values, multipliers: Array) -> float:
        """The error of products of multipliers and distances, as both are rounded."""
        rows = np.concatenate([values.rows, values.rows], axis=1)
        rounded = ROUNDING * (np.abs(rows) + np.abs(self.ends))
        beyond = np.where(self.soft, np.maximum(-self.distances(values, judged=True), 0.0), 0.0)
        steepest = self.linear + 2 * self.quadratic * beyond
        excess = (ROUNDING * steepest + 2 * self.quadratic * rounded) * beyond
        products = np.where(beyond > 0, excess, multipliers * rounded)
        return float(np.max(np.where(self.active, products, 0.0), initial=0.0))

    def central(self, distance: Array, barrier: float) -> Array:
        """z of soft limits at these distances with t·z = v·ν = μ and c + v = t, by bisection.

        c + v − μ/z grows with z: from −∞ at z = 0 to +∞ where ν = 0.
        """
        beyond = np.maximum(-distance, 0.0) + barrier
        low = np.zeros_like(distance)
        high = self.linear + 2 * self.quadratic * (beyond + barrier) + 1.0
        # more halvings than a double has digits
        for _ in range(60):
            z = (low + high) / 2
            # ν v = μ with ν = w₁ − z + 2 w₂ v
            rest, bend = self.linear - z, 2 * self.quadratic
            root = np.sqrt(rest**2 + 4 * bend * barrier)
            # of the two forms of a root of a quadratic the one that subtracts nothing from its like
            smaller = 2 * barrier / np.where(rest + root > 0, rest + root, np.inf)
            larger = (root - rest) / np.where(bend > 0, 2 * bend, np.inf)
            v = np.where(rest >= 0, smaller, np.where(bend > 0, larger, np.inf))
            # z = 0 is the end where μ/z is ∞
            above = distance + v - barrier / np.maximum(z, 1e-300) > 0
            low, high = np.where(above, low, z), np.where(above, z, high)
        return (low + high) / 2


def _with_inside(limits: RowLimits) -> tuple[Array, Array]:
    """The limits; hard ones that are equal are moved apart, so that there is an interior."""
    is_narrow = (limits.high - limits.low < _NARROW) & np.isinf(limits.linear)
    apart = np.where(is_narrow, _APART, 0.0)
    # relative to the limit: 1e-8 is below the rounding of a limit of 1e9
    size = np.maximum(1.0, np.where(np.isfinite(limits.low), np.abs(limits.low), 0.0))
    return limits.low - apart * size, limits.high + apart * size
