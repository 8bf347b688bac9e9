"""Solves an optimal control problem by a primal-dual interior-point method over the stages.

Each limit c(w) ≥ 0 has a slack t > 0 with c(w) = t and a multiplier z, t·z → μ; a soft one has an
excess v > 0 more, c(w) + v = t, which costs w₁ v + w₂ v², with the multiplier ν = w₁ + 2 w₂ v − z,
v·ν → μ (Nocedal, Wright: Numerical Optimization, 2006, ch. 19). Slacks and excesses are eliminated,
so that each step is one Riccati recursion, or one dense system in the controls alone. Costates
follow from the plan: the gradient in the states is 0 always. The curvature is exact where the step
has a minimum with it, and that of the nearest convex stages where not. Steps are cut back by an ℓ₁
merit function.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msnn.features.control.problem.horizon import Array, Given
from msnn.features.control.problem.kkt import greatest
from msnn.features.control.run.interior_point.barrier_problem import (
    ROUNDING,
    BarrierLimits,
    Direction,
    Iterate,
    Merit,
    Point,
    held_gaps,
)
from msnn.features.control.run.interior_point.horizon_functions import (
    HorizonFunctions,
    RowLimits,
    Values,
)
from msnn.features.control.run.interior_point.newton_step import condensed_step, convex, newton_step

# the first μ of a cold start, by the steepest penalty; of a plan that is nearly right a small one
_FIRST_BARRIER = 0.1
_WARM_BARRIER = 1e-4


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of the method: its last iterate, and the residuals there."""

    iterate: Iterate
    residual: float
    """Largest of the optimality conditions, as `Judge` has them; NaN where one is."""
    violation: float
    """Scaled violation of hard limits along the plan; open gaps separate plan and plant."""
    iterations: int


class InteriorPoint:
    """The method for one problem, for the values `given` at one sample, with these limits."""

    def __init__(self, functions: HorizonFunctions, given: Given, limits: RowLimits) -> None:
        self._f, self._given = functions, given
        self._limits = BarrierLimits(functions, limits)
        self._held = functions.held
        self._merit = Merit(functions, given, self._limits)

    def solve(
        self,
        states: Array,
        controls: Array,
        before: Iterate | None,
        *,
        iterations: int,
        tolerance: float,
    ) -> Outcome:
        """Solves from a scaled plan, states (N+1, nx) and controls (N, nu). `before` is the result
        of a neighbouring problem, whose multipliers are used; None is a cold start.

        It ends when the residual is at most the tolerance, after `iterations`, or if no step is
        possible. A NaN ends it too.
        """
        with np.errstate(all="ignore"):
            return self._solved(states, controls, before, iterations, tolerance)

    def _solved(
        self,
        states: Array,
        controls: Array,
        before: Iterate | None,
        iterations: int,
        tolerance: float,
    ) -> Outcome:
        # multipliers of soft limits are between 0 and w₁: the barrier is measured by it
        steepest = float(np.max(self._limits.linear, initial=1.0))
        first = barrier = _FIRST_BARRIER * steepest if before is None else _WARM_BARRIER
        now, values = self._begin(states, controls, before, barrier)
        # the last pass judges where the last step led
        for count in range(iterations + 1):
            point = self._linearised(now, values)
            residual = self._residual(point)
            is_over = not np.isfinite(residual) or residual <= tolerance
            # far from all scales a residual may vanish by rounding alone, which no step makes less
            if residual <= tolerance and not (rounding := self._rounding(point)) <= tolerance:
                residual = rounding
            if is_over or count == iterations:
                return Outcome(now, residual, self._limits.violation(values), count)
            # more than one cut where the point is good enough for the next barrier at once
            while barrier > tolerance / 10 and self._error(point, barrier) < 10 * barrier:
                # superlinear: the smaller μ is, the faster it may fall
                faster = min(0.1, (barrier / first) ** 0.5)
                barrier = max(tolerance / 10, barrier * faster)
            moved = self._moved(point, barrier)
            if moved is None:
                return Outcome(now, residual, self._limits.violation(values), count)
            now, values = moved
        raise AssertionError("the last pass returns")

    # ---- where it begins

    def _begin(
        self, states: Array, controls: Array, before: Iterate | None, barrier: float
    ) -> tuple[Iterate, Values]:
        n, nu, size = self._f.horizon, self._f.controls, len(self._limits.signs) // 2
        own = np.zeros_like(self._limits.active)
        # of each row the low end and the high one
        own[:n, :nu] = own[:n, size : size + nu] = True
        low = np.where(self._limits.active, self._limits.ends, -np.inf)[:n, :nu]
        high = np.where(self._limits.active, self._limits.ends, np.inf)[:n, size : size + nu]
        away = 1e-2 if before is None else 1e-4
        # a start at a limit has the slack 0; in a narrow range a part of its width must do
        push = np.minimum(away, 0.1 * (high - low))
        controls = np.clip(controls, low + push, high - push)
        # x_0 is what was measured, whatever the plan before said of it
        states = np.concatenate([self._given.state[None] / self._f.scale_x, states[1:]])
        values = self._f.values(self._given, states, controls)
        distance = self._limits.distances(values)
        # those of control bounds are exact, and stay so: a linear limit is kept by every step
        slacks = np.where(own, distance, np.maximum(distance, away))
        slacks = np.where(self._limits.active, slacks, 1.0)
        if before is None:
            central = self._limits.central(distance, barrier)
            multipliers = np.where(self._limits.soft, central, barrier / slacks)
            # of soft limits t = μ/z on the central path, so that the first step is not cut
            slacks = np.where(
                self._limits.soft, barrier / np.where(self._limits.soft, central, 1.0), slacks
            )
        else:
            # a multiplier of nearly 0 takes many steps to grow
            multipliers = np.maximum(before.multipliers, barrier / 10)
            # above w₁ the multiplier of the excess would be below 0
            cap = np.where(self._limits.soft, 0.9 * self._limits.linear, np.inf)
            multipliers = np.minimum(multipliers, cap)
        multipliers = np.where(self._limits.active, multipliers, 0.0)
        # a rest that rounding leaves must not be 0: it has a logarithm
        excesses = np.where(self._limits.soft, np.maximum(slacks - distance, barrier * 1e-9), 0.0)
        rest = self._limits.linear + 2 * self._limits.quadratic * excesses - multipliers
        others = np.where(self._limits.soft, np.maximum(rest, 1e-9), 0.0)
        return Iterate(
            states=states,
            controls=controls,
            slacks=slacks,
            multipliers=multipliers,
            excesses=excesses,
            excess_multipliers=others,
        ), values

    # ---- how good it is

    def _linearised(self, now: Iterate, values: Values) -> Point:
        f, n, nx = self._f, self._f.horizon, self._f.states
        slopes = f.slopes(self._given, now.states, now.controls)
        gradient = slopes.cost + np.einsum(
            "km,kmw->kw", self._limits.by_row(now.multipliers), slopes.rows
        )
        costates = np.zeros((n, nx))
        costate = gradient[n, :nx]
        worst = 0.0
        for k in range(n - 1, -1, -1):
            costates[k] = costate
            # costates that make the gradient in the states 0: only controls are left to judge
            whole = gradient[k] + slopes.following[k].T @ costate
            costate = whole[:nx]
            # a held control is a function of the state: its slope goes on to where it was decided
            if self._held.stages[k]:
                costate = costate + self._held.selection.T @ whole[nx:]
            else:
                worst = max(worst, greatest(whole[nx:]))
        # Python's `max` keeps the number where the other is NaN
        if not np.all(np.isfinite(gradient)):
            worst = np.nan
        misfits = self._limits.distances(values) + now.excesses - now.slacks
        misfits = np.where(self._limits.active, misfits, 0.0)
        return Point(
            now=now,
            values=values,
            slopes=slopes,
            costates=costates,
            gaps=values.following - now.states[1:],
            misfits=misfits,
            stationarity=worst,
        )

    def _residual(self, point: Point) -> float:
        distance, z = self._limits.distances(point.values, judged=True), point.now.multipliers
        beyond = np.maximum(-distance, 0.0)
        steepest = self._limits.linear + 2 * self._limits.quadratic * beyond
        hard = np.where(self._limits.soft, 0.0, np.maximum(beyond, z * np.abs(distance)))
        excess = np.maximum(np.abs(z - steepest) * beyond, z - steepest)
        soft = np.where(self._limits.soft, np.maximum(z * np.maximum(distance, 0.0), excess), 0.0)
        held = held_gaps(self._f, point.now)
        parts = (point.stationarity, greatest(point.gaps), greatest(hard), greatest(soft))
        # 0 · ∞ and 0 · NaN are NaN: a cost that is not finite ends the method
        return float(np.max([*parts, greatest(held), 0.0 * point.values.cost]))

    def _rounding(self, point: Point) -> float:
        """The rounding error of the residual: half a unit in the last place of its largest sum of
        terms.
        """
        f, slopes, costates = self._f, point.slopes, point.costates
        # a multiplier pulls at its row from either end
        sums = np.abs(point.now.multipliers).reshape(f.horizon + 1, 2, -1).sum(axis=1)
        terms = np.abs(slopes.cost) + np.einsum("km,kmw->kw", sums, np.abs(slopes.rows))
        terms[:-1] += np.einsum("kx,kxw->kw", np.abs(costates), np.abs(slopes.following))
        parts = (greatest(terms[:, f.states :]), greatest(point.now.states))
        return ROUNDING * max(parts) + self._limits.rounding(point.values, point.now.multipliers)

    def _error(self, point: Point, barrier: float) -> float:
        """The largest residual of the equations of the barrier problem with this barrier."""
        now = point.now
        products = np.where(self._limits.active, now.slacks * now.multipliers - barrier, 0.0)
        others = np.where(self._limits.soft, now.excesses * now.excess_multipliers - barrier, 0.0)
        parts = (point.gaps, point.misfits, products, others, held_gaps(self._f, now))
        return max(point.stationarity, *(greatest(part) for part in parts))

    # ---- where it goes

    def _moved(self, point: Point, barrier: float) -> tuple[Iterate, Values] | None:
        """The next iterate with its values; None if a derivative is not finite or no step is
        possible.
        """
        f, now = self._f, point.now
        rows = self._limits.by_row(now.multipliers)
        if f.problem.hessian == "exact":
            # exact curvature first, which converges quadratically; the convex one always has a
            # minimum
            hessian = f.curvature(self._given, now.states, now.controls, rows, point.costates)
            tries = (hessian, convex(hessian))
        else:
            # the plant and limits count as linear: Gauss and Newton
            rows, costates = np.zeros_like(rows), np.zeros_like(point.costates)
            hessian = f.curvature(self._given, now.states, now.controls, rows, costates)
            tries = (convex(hessian),)
        if not np.all(np.isfinite(hessian)):
            return None
        best: tuple[Iterate, Values] | None = None
        for curvature in tries:
            direction = self._direction(point, curvature, barrier)
            if direction is None:
                continue
            found, accepted = self._merit.searched(point, direction, curvature, barrier)
            if accepted:
                return found
            best = found or best
        # a merit that does not fall, but a point that is finite: the next pass begins from there
        return best

    def _direction(self, point: Point, hessian: Array, barrier: float) -> Direction | None:
        now, slopes, limits = point.now, point.slopes, self._limits
        t, z, v, nu = now.slacks, now.multipliers, now.excesses, now.excess_multipliers
        z_or_1 = np.where(limits.active, z, 1.0)
        # ν + 2 w₂ v is what v's own equation is divided by; hard limits have v = 0 and need no such
        bend = np.where(limits.soft, nu + 2 * limits.quadratic * v, 1.0)
        misfit = np.where(limits.soft, limits.linear + 2 * limits.quadratic * v - z - nu, 0.0)
        room = np.where(limits.soft, (barrier - v * nu - v * misfit) / bend, 0.0)
        # of a hard limit z/t: the nearer the limit, the stiffer
        stiffness = np.where(limits.active, 1 / (t / z_or_1 + v / bend), 0.0)
        offset = point.misfits + room - barrier / z_or_1 + t
        size = len(limits.signs) // 2
        # low and high end pull at the same row; the signs are ±1, and their squares 1
        weights = stiffness[:, :size] + stiffness[:, size:]
        whole = hessian + np.einsum("kmi,km,kmj->kij", slopes.rows, weights, slopes.rows)
        if not np.all(np.isfinite(whole)):
            return None
        pull = limits.by_row(z - stiffness * offset)
        gradient = slopes.cost + np.einsum("km,kmw->kw", pull, slopes.rows)
        gaps = held_gaps(self._f, now)
        step = condensed_step if self._f.structure == "condensed" else newton_step
        found = step(whole, gradient, slopes.following, point.gaps, self._held, gaps)
        if found is None:
            return None
        states, controls = found
        # at N there is no control that could move
        moves = np.concatenate([states, np.concatenate([controls, controls[:1] * 0])], axis=1)
        rows = np.einsum("kmw,kw->km", slopes.rows, moves)
        change = limits.signs * np.concatenate([rows, rows], axis=1)
        # back from the row's move to what was eliminated: dz, then t from t z = μ, then v
        dz = -stiffness * (change + offset)
        dt = np.where(limits.active, barrier / z_or_1 - t - t / z_or_1 * dz, 0.0)
        dv = np.where(limits.soft, room + v / bend * dz, 0.0)
        others = np.where(limits.soft, misfit + 2 * limits.quadratic * dv - dz, 0.0)
        return Direction(
            states=states,
            controls=controls,
            slacks=dt,
            multipliers=dz,
            excesses=dv,
            excess_multipliers=others,
        )
