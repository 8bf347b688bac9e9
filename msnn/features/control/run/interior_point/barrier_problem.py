"""Defines the barrier problem: iterates, limits c(w) ≥ 0, and a line search on its merit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msnn.features.control.problem.horizon import Array, Given
from msnn.features.control.run.interior_point.horizon_functions import (
    HorizonFunctions,
    RowLimits,
    Slopes,
    Values,
)


@dataclass(frozen=True, slots=True)
class Iterate:
    """An iterate of the method, in scaled variables: a plan, and values of its m limits with a
    minimum and a maximum each, first all minima.

    Slacks, multipliers, excesses (violations of soft limits) and multipliers of excesses are (N+1,
    2m).
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
    """A Newton step: the changes of all parts of an iterate, in their shapes."""

    states: Array
    controls: Array
    slacks: Array
    multipliers: Array
    excesses: Array
    excess_multipliers: Array


ROUNDING = float(np.finfo(np.float64).eps) / 2
"""The largest error of a rounded number, by its size."""

_NARROW = 1e-7
"""Limits that leave less than this, scaled, are set apart so that there is an inside …"""
_APART = 1e-8
"""… by this."""


class BarrierLimits:
    """The limits of the rows h as conditions c(w) ≥ 0, (N+1, 2m): first c = h − low, then c = high
    − h.
    """

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
        """c of every limit, (N+1, 2m), 0 where there is none. With `judged` for the original
        limits, else for those of which equal ones are moved apart.
        """
        both = np.concatenate([values.rows, values.rows], axis=1)
        ends = self._judged_ends if judged else self.ends
        return np.where(self.active, self.signs * (both - ends), 0.0)

    def by_row(self, multipliers: Array) -> Array:
        """The factor of each row's gradient in the Lagrangian, (N+1, m): multiplier of the maximum
        minus that of the minimum.
        """
        size = len(self.signs) // 2
        signed = -self.signs * multipliers
        return signed[:, :size] + signed[:, size:]

    def violation(self, values: Values) -> float:
        """The largest violation of hard limits, scaled, for the original limits; 0 if they hold."""
        distance = self.distances(values, judged=True)
        hard = np.where(self.active & ~self.soft, -distance, 0.0)
        return float(np.max(hard, initial=0.0))

    def rounding(self, values: Values, multipliers: Array) -> float:
        """A bound on the rounding error of the products of multipliers and distances."""
        rows = np.concatenate([values.rows, values.rows], axis=1)
        rounded = ROUNDING * (np.abs(rows) + np.abs(self.ends))
        beyond = np.where(self.soft, np.maximum(-self.distances(values, judged=True), 0.0), 0.0)
        steepest = self.linear + 2 * self.quadratic * beyond
        excess = (ROUNDING * steepest + 2 * self.quadratic * rounded) * beyond
        products = np.where(beyond > 0, excess, multipliers * rounded)
        return float(np.max(np.where(self.active, products, 0.0), initial=0.0))

    def central(self, distance: Array, barrier: float) -> Array:
        """The multipliers z of soft limits with these distances c on the central path, by
        bisection: t·z = v·ν = μ and c + v = t, where t is the slack, v the excess, ν its multiplier
        and μ the barrier.

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
    """The low and high limits; hard ones that are nearly equal are moved apart, so that there is an
    interior.
    """
    is_narrow = (limits.high - limits.low < _NARROW) & np.isinf(limits.linear)
    apart = np.where(is_narrow, _APART, 0.0)
    # relative to the limit: 1e-8 is below the rounding of a limit of 1e9
    size = np.maximum(1.0, np.where(np.isfinite(limits.low), np.abs(limits.low), 0.0))
    return limits.low - apart * size, limits.high + apart * size


# a step ends before the limit: at a slack of 0 the logarithm has no value (Nocedal, Wright 2006,
# equation 19.9)
_TO_BOUNDARY = 0.995
_CUTS = 14
_ARMIJO = 1e-4


class Merit:
    """The ℓ₁ merit function of one problem: cost, penalties and barrier, plus a weight times the
    violation of the equations. The weight is kept from step to step.
    """

    def __init__(self, functions: HorizonFunctions, given: Given, limits: BarrierLimits) -> None:
        self._f, self._given, self._limits = functions, given, limits
        # as small as may be: it is raised where a step would not decrease the merit
        self._weight = 1e-6

    def searched(
        self, point: Point, step: Direction, hessian: Array, barrier: float
    ) -> tuple[tuple[Iterate, Values] | None, bool]:
        """The iterate along the step at which the merit has decreased enough, with its values, and
        True. Otherwise the last iterate with a finite merit, or None, and False.

        `hessian` is that of the step, `barrier` is μ.
        """
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
        """The directional derivative of the merit along the step. Increases the weight of the
        violation if the merit would not decrease otherwise.
        """
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
    """The differences between controls within a block and the control that they must equal, (N,
    nu), scaled.
    """
    gaps = functions.held.gaps(now.states, now.controls)
    return np.where(functions.held.stages[:, None], gaps, 0.0)


def _longest(values: Array, step: Array) -> float:
    """The largest fraction of a step, at most 1, that keeps all values above 0."""
    falls = step < 0
    ratios = -_TO_BOUNDARY * values[falls] / step[falls]
    return float(np.min(ratios, initial=1.0))
