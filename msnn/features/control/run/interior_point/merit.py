"""Line search along a step until the merit decreases enough.

The merit is the cost with penalties of excesses and the barrier −μ Σ log of slacks and excesses,
plus a weight times what equations are off by (an ℓ₁ merit function: Nocedal, Wright: Numerical
Optimization, 2006, section 18.3).
"""

from __future__ import annotations

import numpy as np

from msnn.features.control.problem.optimal_control.horizon import Array, Given
from msnn.features.control.run.interior_point.barrier_limits import BarrierLimits
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.interior_point.horizon_values import Values
from msnn.features.control.run.interior_point.iterate import Direction, Iterate, Point

# a step ends before the limit: at a slack of 0 the logarithm has no value (Nocedal, Wright 2006,
# equation 19.9)
_TO_BOUNDARY = 0.995
_CUTS = 14
_ARMIJO = 1e-4


class Merit:
    """The merit function of one problem; it keeps the weight of the residuals of its equations."""

    def __init__(self, functions: HorizonFunctions, given: Given, limits: BarrierLimits) -> None:
        self._f, self._given, self._limits = functions, given, limits
        # as small as may be: it is raised where a step would not decrease the merit
        self._weight = 1e-6

    def searched(
        self, point: Point, step: Direction, hessian: Array, barrier: float
    ) -> tuple[tuple[Iterate, Values] | None, bool]:
        """The iterate along the step where the merit is low enough, and whether there was one."""
        now = point.now
        # primal and dual parts each as far as they may: the merit knows no multipliers
        primal = min(_longest(now.slacks, step.slacks), _longest(now.excesses, step.excesses))
        dual = min(
            _longest(now.multipliers, step.multipliers),
            _longest(now.excess_multipliers, step.excess_multipliers),
        )
        slope = self._slope(point, step, hessian, barrier)
        before = self.merit(now, point.values, barrier)
        found: tuple[Iterate, Values] | None = None
        for cut in range(_CUTS):
            length = primal * 0.5**cut
            trial = Iterate(
                states=now.states + length * step.states,
                controls=now.controls + length * step.controls,
                slacks=now.slacks + length * step.slacks,
                multipliers=now.multipliers + dual * step.multipliers,
                excesses=now.excesses + length * step.excesses,
                excess_multipliers=now.excess_multipliers + dual * step.excess_multipliers,
            )
            values = self._f.values(self._given, trial.states, trial.controls)
            merit = self.merit(trial, values, barrier)
            if np.isfinite(merit):
                found = trial, values
            # near the solution the merit changes less than its own rounding, which must not refuse
            # the step
            if merit <= before + _ARMIJO * length * slope + 1e-10 * abs(before):
                return found, True
        return found, False

    def _infeasibility(self, now: Iterate, values: Values) -> float:
        misfits = np.where(
            self._limits.active, self._limits.distances(values) + now.excesses - now.slacks, 0.0
        )
        gaps = values.following - now.states[1:]
        return sum(float(np.sum(np.abs(v))) for v in (misfits, gaps, held_gaps(self._f, now)))

    def merit(self, now: Iterate, values: Values, barrier: float) -> float:
        penalties = self._limits.linear * now.excesses + self._limits.quadratic * now.excesses**2
        logs = np.log(np.where(self._limits.active, now.slacks, 1.0))
        logs += np.log(np.where(self._limits.soft, now.excesses, 1.0))
        smooth = values.cost + float(np.sum(penalties) - barrier * np.sum(logs))
        return smooth + self._weight * self._infeasibility(now, values)

    def _slope(self, point: Point, step: Direction, hessian: Array, barrier: float) -> float:
        """The merit's slope along the step; raises the weight of infeasibility where it must."""
        now = point.now
        # stage N has no control
        last = np.zeros((1, step.controls.shape[1]))
        moves = np.concatenate([step.states, np.concatenate([step.controls, last])], axis=1)
        marginal = self._limits.linear + 2 * self._limits.quadratic * now.excesses
        marginal = marginal - barrier / np.where(self._limits.soft, now.excesses, 1.0)
        slope = float(np.sum(point.slopes.cost * moves))
        slope += float(np.sum(np.where(self._limits.soft, marginal * step.excesses, 0.0)))
        slope -= barrier * float(np.sum(step.slacks / now.slacks))
        bend = float(np.einsum("ki,kij,kj->", moves, hessian, moves))
        infeasible = self._infeasibility(now, point.values)
        if infeasible > 1e-12:
            # above this weight the merit falls along the step (Nocedal, Wright 2006, equation
            # 18.36, ρ = 0.1)
            wanted = (slope + 0.5 * max(bend, 0.0)) / (0.9 * infeasible)
            if wanted > self._weight:
                # twice as much, so that it is not raised again at every step
                self._weight = 2 * wanted
        return slope - self._weight * infeasible


def held_gaps(functions: HorizonFunctions, now: Iterate) -> Array:
    """The distances of controls within a block from the one that they are held at, (N, nu)."""
    gaps = functions.held.gaps(now.states, now.controls)
    return np.where(functions.held.stages[:, None], gaps, 0.0)


def _longest(values: Array, step: Array) -> float:
    """The longest part of a step that keeps values above 0."""
    falls = step < 0
    ratios = -_TO_BOUNDARY * values[falls] / step[falls]
    return float(np.min(ratios, initial=1.0))
