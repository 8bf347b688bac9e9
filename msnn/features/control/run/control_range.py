"""Keeps controls within their own limits: bounds, and rates from sample to sample."""

from __future__ import annotations

import numpy as np

from msnn.features.control.problem.horizon import Array, Given
from msnn.features.control.run.interior_point.barrier_problem import BarrierLimits
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions, RowLimits


class ControlRange:
    """The controls, divided by their scales, that one solve may return: within their bounds, and
    within their rates from the control that `state` (x_0) contains. `limits` are those of all rows.
    """

    def __init__(self, functions: HorizonFunctions, limits: RowLimits, state: Array) -> None:
        n, nu = functions.horizon, functions.controls
        self.limits = limits
        self._functions = functions
        self._starts = functions.starts
        self._low, self._high = limits.low[:n, :nu].copy(), limits.high[:n, :nu].copy()
        self._move = limits.high[:n, nu : 2 * nu]
        scaled = state / functions.scale_x
        has_before = np.any(functions.held.selection != 0, axis=1)
        # NaN: nobody knows what was applied, so that nothing limits the first move
        self._before = np.where(has_before, functions.held.selection @ scaled, np.nan)
        self._reachable = self._ranges()

    @property
    def is_possible(self) -> bool:
        """True if some sequence of controls keeps all limits."""
        low, high = self._reachable
        return bool(np.all(low <= high))

    def nearest(self, controls: Array) -> Array:
        """The controls (N, nu), scaled, within all limits that are nearest to the given ones, one
        stage after the other. If limits contradict each other, the bounds hold and rates may be
        exceeded.
        """
        found = np.empty_like(controls)
        before = self._before
        low, high = self._by_block()
        # where the limits to come can still be reached
        ahead = self._leads_on()
        for k in range(len(controls)):
            if not self._starts[k]:
                found[k] = before
                continue
            reach = np.where(np.isnan(before), np.inf, self._move[k])
            origin = np.where(np.isnan(before), 0.0, before)
            # a move of ∞ from 0 is no limit; NaN would be carried into both ends
            lowest = np.maximum(np.maximum(low[k], ahead[0][k]), origin - reach)
            highest = np.minimum(np.minimum(high[k], ahead[1][k]), origin + reach)
            # where limits contradict each other, the box wins
            found[k] = np.clip(np.clip(controls[k], lowest, highest), self._low[k], self._high[k])
            before = found[k]
        return found

    def blocked(self, controls: Array) -> Array:
        """A copy of the controls (N, nu) in which those of a block all equal its first."""
        found = controls.copy()
        for k in range(1, len(found)):
            if not self._starts[k]:
                found[k] = found[k - 1]
        return found

    def first(self, control: Array) -> Array:
        """The allowed control (nu) at t that is nearest to the given one, scaled."""
        return self.nearest(np.tile(control, (len(self._low), 1)))[0]

    def violation(self, given: Given, controls: Array) -> float:
        """The largest scaled violation of hard limits in a simulation with these scaled controls; 0
        without hard limits.
        """
        functions = self._functions
        if not any(path.hard for path in functions.problem.path_limits):
            return 0.0
        with np.errstate(all="ignore"):
            values = functions.values(given, functions.rollout(given, controls), controls)
            return BarrierLimits(functions, self.limits).violation(values)

    def _by_block(self) -> tuple[Array, Array]:
        """The bounds (N, nu) by stage; at the first stage of a block those of all its stages
        together.
        """
        low, high = self._low.copy(), self._high.copy()
        for k in range(len(low) - 1, 0, -1):
            if not self._starts[k]:
                # a block keeps one control: it has to be within the limits of all its samples
                low[k - 1] = np.maximum(low[k - 1], low[k])
                high[k - 1] = np.minimum(high[k - 1], high[k])
        return low, high

    def _leads_on(self) -> tuple[Array, Array]:
        """The ranges (N, nu) of controls from which the bounds of all later stages can still be
        reached.
        """
        low, high = self._by_block()
        for k in range(len(low) - 2, -1, -1):
            # one sample earlier, as far as one move can make up for
            move = self._move[k + 1] if self._starts[k + 1] else 0.0
            low[k] = np.maximum(low[k], low[k + 1] - move)
            high[k] = np.minimum(high[k], high[k + 1] + move)
        return low, high

    def _ranges(self) -> tuple[Array, Array]:
        """The ranges (N, nu) of controls that can be reached from the previous control
        and lead on.
        """
        low, high = self._leads_on()
        for k in range(len(low)):
            if k == 0:
                known = ~np.isnan(self._before)
                move = np.where(known, self._move[0], np.inf)
                # forwards then: what can be reached from what was applied
                origin = np.where(known, self._before, 0.0)
                low[0] = np.maximum(low[0], origin - move)
                high[0] = np.minimum(high[0], origin + move)
            else:
                move = self._move[k] if self._starts[k] else 0.0
                low[k] = np.maximum(low[k], low[k - 1] - move)
                high[k] = np.minimum(high[k], high[k - 1] + move)
        return low, high
