"""Solves from sample to sample by the interior-point method in Python: the reference."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from msnn.features.control.problem.optimal_control.horizon import Array, Given
from msnn.features.control.problem.optimal_control.problem import ControlProblem
from msnn.features.control.run.control_range import ControlRange
from msnn.features.control.run.interior_point.barrier_limits import BarrierLimits
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.interior_point.interior_point import InteriorPoint, Outcome
from msnn.features.control.run.interior_point.iterate import Iterate
from msnn.features.control.run.method import Found, Solver
from msnn.features.control.run.solution import Status

_FAR = 1e4
"""A cold start that leads beyond so many scales is no help."""


class ReferenceMethod:
    """The method of one controller, with the plan of its last solve."""

    name: Solver = "python"

    def __init__(self, problem: ControlProblem, functions: HorizonFunctions) -> None:
        self._problem, self._functions = problem, functions
        self._last: Iterate | None = None
        self._is_good = False
        self._has_failed_anew = False
        """Whether the last solve began without a plan and found none."""

    def forget(self, applied: Array | None) -> None:
        self._last, self._is_good, self._has_failed_anew = None, False, False

    def solve(self, given: Given, allowed: ControlRange, resting: Array) -> Found:
        method = InteriorPoint(self._functions, given, allowed.limits)
        may_begin_again = self._problem.mode == "converged"
        iterations, tolerance = self._problem.iterations, self._problem.tolerance
        solve = partial(method.solve, iterations=iterations, tolerance=tolerance)
        outcome: Outcome | None = None
        # only a plan that was solved: one that broke limits has multipliers that cannot hold
        # (decision 0326)
        if self._last is not None and self._is_good:
            before = _shifted(self._last)
            controls = allowed.blocked(before.controls)
            outcome = solve(before.states, controls, before)
        # in the mode `fixed` a second solve would take twice the time that was promised
        if outcome is None or (may_begin_again and not outcome.residual <= tolerance):
            states, controls = self._cold(given, allowed, resting)
            again = solve(states, controls, None)
            spent = 0 if outcome is None else outcome.iterations
            again = replace(again, iterations=spent + again.iterations)
            # not less or equal: also where the first one is NaN
            if outcome is None or not outcome.residual <= again.residual:
                outcome = again
        return self._found(given, allowed, outcome)

    def _cold(self, given: Given, allowed: ControlRange, resting: Array) -> tuple[Array, Array]:
        """A plan to begin with: the last one clipped and rolled out, or what is applied now; where
        that has just failed, controls at rest."""
        n, scale = self._problem.horizon, self._functions.scale_u
        begun = self._functions.resting if self._has_failed_anew else resting
        controls = np.tile(begun / scale, (n, 1))
        if self._last is not None:
            controls = _shifted(self._last).controls
        controls = allowed.nearest(np.where(np.isfinite(controls), controls, 0.0))
        states = self._functions.rollout(given, controls)
        start = given.state / self._functions.scale_x
        limit = _FAR * max(1.0, float(np.max(np.abs(start), initial=0.0)))
        # an unstable plant runs away along a plan that no longer fits: rest is a better start
        # (decision 0290)
        if not np.all(np.abs(states) <= limit):
            states = np.tile(start, (n + 1, 1))
        return states, controls

    def _found(self, given: Given, allowed: ControlRange, outcome: Outcome) -> Found:
        f, tolerance = self._functions, self._problem.tolerance
        is_solved = bool(outcome.residual <= tolerance)
        is_finite = np.isfinite(outcome.residual)
        # rounding and gaps leave controls a little outside: what is returned is inside
        controls = allowed.nearest(outcome.iterate.controls)
        violation = outcome.violation
        # the plan keeps limits on paper; what counts is where its controls lead
        if not is_solved:
            violation = float(np.maximum(violation, self._violation(given, allowed, controls)))
        keeps = violation <= max(tolerance, 1e-6)
        status = Status.SOLVED if is_solved else Status.CAPPED
        is_plan = is_finite and keeps
        # a plan that broke limits leads the next solve astray (decision 0326)
        self._has_failed_anew = not is_plan and self._last is None
        self._last, self._is_good = outcome.iterate if is_plan else None, is_solved
        states = outcome.iterate.states
        with np.errstate(all="ignore"):
            values = f.values(given, states, controls)
        return Found(
            status=status if is_plan else Status.INFEASIBLE,
            plan=f.plan(states, controls),
            values=values,
            multipliers=f.multipliers(outcome.iterate.multipliers),
            residual=outcome.residual,
            violation=violation,
            iterations=outcome.iterations,
        )

    def _violation(self, given: Given, allowed: ControlRange, controls: Array) -> float:
        """The violation of hard limits where the controls lead: a plan's gaps may hide one."""
        if not any(path.hard for path in self._problem.path_limits):
            return 0.0
        with np.errstate(all="ignore"):
            states = self._functions.rollout(given, controls)
            values = self._functions.values(given, states, controls)
            return BarrierLimits(self._functions, allowed.limits).violation(values)


def _shifted(before: Iterate) -> Iterate:
    """The plan of the sample before, as it is from now on; its end is repeated."""

    def later(values: Array) -> Array:
        return np.concatenate([values[1:], values[-1:]])

    def inside(values: Array) -> Array:
        """Stage N lacks limits that stage N−1 has: that one is repeated."""
        return np.concatenate([values[1:-1], values[-2:-1], values[-1:]])

    return Iterate(
        states=later(before.states),
        controls=later(before.controls),
        slacks=inside(before.slacks),
        multipliers=inside(before.multipliers),
        excesses=inside(before.excesses),
        excess_multipliers=inside(before.excess_multipliers),
    )
