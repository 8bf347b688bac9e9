"""Solves from sample to sample by the interior-point method in Python: the reference."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from msnn.features.control.problem.horizon import Array, Given
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.run.control_range import ControlRange
from msnn.features.control.run.interior_point.barrier_problem import Iterate
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.interior_point.interior_point import InteriorPoint, Outcome
from msnn.features.control.run.method import Found, Solver, Status

_FAR = 1e4
"""A cold start that leads beyond so many scales is no help."""


class ReferenceMethod:
    """The solver of one controller in Python, with the plan of its last solve."""

    name: Solver = "python"

    def __init__(self, problem: ControlProblem, functions: HorizonFunctions) -> None:
        self._problem, self._functions = problem, functions
        self._last: Iterate | None = None
        self._has_failed_anew = False
        """Whether the last solve began without a plan and found none."""

    def forget(self, applied: Array | None) -> None:
        self._last, self._has_failed_anew = None, False

    def solve(self, given: Given, allowed: ControlRange, resting: Array) -> Found:
        method = InteriorPoint(self._functions, given, allowed.limits)
        iterations, tolerance = self._problem.iterations, self._problem.tolerance
        solve = partial(method.solve, iterations=iterations, tolerance=tolerance)
        if self._last is None:
            begun = self._functions.resting if self._has_failed_anew else resting
            return self._found(given, allowed, solve(*self._cold(given, allowed, begun), None))
        before = _shifted(self._last)
        outcome = solve(before.states, allowed.blocked(before.controls), before)
        # in the mode `fixed` a second solve would take twice the time that was promised, unless the
        # first one ended where it began
        may_begin_again = self._problem.mode == "converged" or outcome.iterations == 0
        if may_begin_again and not outcome.residual <= tolerance:
            again = solve(*self._cold(given, allowed, self._functions.resting), None)
            spent = outcome.iterations + again.iterations
            # not less or equal: also where the first one is NaN
            if not outcome.residual <= again.residual:
                outcome = again
            outcome = replace(outcome, iterations=spent)
        return self._found(given, allowed, outcome)

    def _cold(self, given: Given, allowed: ControlRange, begun: Array) -> tuple[Array, Array]:
        """An initial plan, scaled: the control `begun` (nu) is held within its limits, and the
        states are simulated, or all equal x_0 if the simulation diverges.
        """
        n = self._problem.horizon
        controls = allowed.nearest(np.tile(begun / self._functions.scale_u, (n, 1)))
        states = self._functions.rollout(given, controls)
        start = given.state / self._functions.scale_x
        limit = _FAR * max(1.0, float(np.max(np.abs(start), initial=0.0)))
        with np.errstate(all="ignore"):
            has_values = self._functions.values(given, states, controls).are_finite
        # an unstable plant runs away under a control that does not fit, and a tank is emptied below
        # where a root has values: rest is a better start (decisions 0491 and 0491)
        if not (has_values and np.all(np.abs(states) <= limit)):
            states = np.tile(start, (n + 1, 1))
        return states, controls

    def _found(self, given: Given, allowed: ControlRange, outcome: Outcome) -> Found:
        f, tolerance = self._functions, self._problem.tolerance
        is_solved = bool(outcome.residual <= tolerance)
        is_finite = np.isfinite(outcome.residual)
        # rounding and gaps leave controls a little outside: what is returned is inside
        controls = allowed.nearest(outcome.iterate.controls)
        # a plan that is not solved keeps limits on paper; what counts is where its controls lead
        is_cut = is_finite and not is_solved
        violation = allowed.violation(given, controls) if is_cut else outcome.violation
        keeps = violation <= max(tolerance, 1e-6)
        status = Status.SOLVED if is_solved else Status.CAPPED
        is_plan = is_finite and keeps
        # a plan that broke limits leads the next solve astray (decision 0491)
        self._has_failed_anew = not is_plan and self._last is None
        self._last = outcome.iterate if is_plan else None
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


def _shifted(before: Iterate) -> Iterate:
    """The plan of the previous sample, shifted by one stage; its last stage is repeated."""

    def later(values: Array) -> Array:
        return np.concatenate([values[1:], values[-1:]])

    def inside(values: Array) -> Array:
        """Shifts values of limits: stage N lacks limits that stage N−1 has, so that stage is
        repeated.
        """
        return np.concatenate([values[1:-1], values[-2:-1], values[-1:]])

    return Iterate(
        states=later(before.states),
        controls=later(before.controls),
        slacks=inside(before.slacks),
        multipliers=inside(before.multipliers),
        excesses=inside(before.excesses),
        excess_multipliers=inside(before.excess_multipliers),
    )
