"""Estimates states and parameters by the best fit to a window of samples.

A filter runs along: where a window is not solved, its estimate stands. Another one goes over the
samples that leave the window, with slopes at what the window made of them, and says what was known
of its first sample before: the arrival cost (decision 0321).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from compiler.jacobian.matrices import by_name
from msnn.features.control.kalman.estimate import (
    Estimate,
    FilterStatus,
    WindowEstimate,
)
from msnn.features.control.kalman.kalman_filter import KalmanFilter
from msnn.features.control.problem.moving_horizon.spread import spread_of
from msnn.features.control.problem.moving_horizon.trained_window import trained_window
from msnn.features.control.problem.moving_horizon.window_problem import window_problem
from msnn.features.control.problem.optimal_control.horizon import Array, Given
from msnn.features.control.problem.optimal_control.kkt import Judge, Residuals
from msnn.features.control.problem.optimal_control.problem import ControlProblem
from msnn.features.control.problem.state_estimation.problem import EstimationProblem
from msnn.features.control.run.control_range import ControlRange
from msnn.features.control.run.estimation.window_data import WindowData
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.method import Found, Method
from msnn.features.control.run.solution import Status

if TYPE_CHECKING:
    from msnn.features.control.casadi.optimal_control import OptimalControlNlp

_OF_SOLVES = {Status.SOLVED: FilterStatus.FILTERED, Status.CAPPED: FilterStatus.CAPPED}
_REFUSED = (FilterStatus.INPUT_NOT_FINITE, FilterStatus.NOT_INITIALISED)
_FIRST = 1
"""The stage of a full window's first sample; the one before it starts there."""


class MovingHorizon:
    """The estimator of an `mhe` section; it remembers a window of samples."""

    def __init__(
        self,
        problem: EstimationProblem,
        weights: Mapping[str, ArrayLike],
        method: Callable[[ControlProblem, HorizonFunctions], Method],
    ) -> None:
        """`method` solves the problem of a window."""
        self.problem = problem
        # where a window fails, its estimate stands
        self.filter = KalmanFilter(problem, weights)
        """It runs along."""
        # what is known of the window's first sample before what was measured there
        self._arrival = KalmanFilter(problem, weights)
        self._window = window_problem(problem)
        self.control = trained_window(self._window, weights)
        """The problem of the window, as an optimal control problem whose controls are noise."""
        self._functions = HorizonFunctions(self.control)
        self._method = method(self.control, self._functions)
        self.solver = self._method.name
        """`c` or `python`: who solves."""
        self.numbers = self.filter.numbers
        self.given: Given | None = None
        """The data of the last solved window."""
        self.found: Found | None = None
        """The solver's result for the last window."""
        self.reset()

    def reset(self, x: Mapping[str, ArrayLike] | None = None) -> None:
        """Begins anew, from states where they are given; others as `init` says without a log."""
        self.filter.reset(x)
        self._arrival.reset(x)
        # NaN is what is not given, so that the first inputs may fill it
        self._x = {name: v for name, v in (x or {}).items() if np.all(np.isfinite(v))}
        self._data = WindowData(self._window)
        self._method.forget(None)
        self.vector: Array = self.filter.vector.copy()
        """ξ, the states and the estimated parameters of the last estimate."""
        self.given, self.found = None, None
        self._before: Array | None = None

    def correct(
        self,
        measured: Mapping[str, ArrayLike],
        inputs: Mapping[str, ArrayLike] | None = None,
    ) -> WindowEstimate:
        """The estimate at t, from the measurements at t and in the window; NaN marks missing ones.

        `inputs` at t are wanted where measured outputs read them. Raises ValueError where one of
        these is missing, and for a name or a shape that the problem does not have.
        """
        # first: where it refuses, the window has no new sample. The window takes the newest of
        # numbers of a sample, the filter each once
        filtered = self.filter.correct(self._data.fresh(measured), inputs)
        self.found = None
        if filtered.status in _REFUSED:
            self.vector = self.filter.vector.copy()
            return self._told(filtered, filtered.status)
        self._data.measure({name: np.asarray(v, float) for name, v in measured.items()})
        self._data.give({name: np.asarray(v, float) for name, v in (inputs or {}).items()})
        self._learn_pasts()
        # bounds hold at the start too; noise of 0 then keeps them
        start = self.filter.within(self._arrival.vector)
        # again at each sample: the arrival filter moved
        self._data.begin(spread_of(self._arrival.covariance, self._window.uncertain))
        held = {
            # what is not previewed is one row, the same at every stage
            name: values if len(values) > 1 else np.repeat(values, self.control.horizon + 1, axis=0)
            for name, values in self._data.references.items()
        }
        self.given = Given(start, {}, {name: values.copy() for name, values in held.items()})
        limits = self._functions.limits(self.given)
        allowed = ControlRange(self._functions, limits, start)
        found = self._method.solve(self.given, allowed, self._functions.resting)
        # the window ends at t: its last state is the estimate
        newest = found.plan.states[-1]
        status = _OF_SOLVES.get(found.status)
        if status is None or not np.all(np.isfinite(newest)):
            # what ran away is no plan to begin the next solve at
            self._method.forget(None)
            self._before = None
            self.vector = self.filter.vector.copy()
            return self._told(filtered, FilterStatus.DIVERGED)
        self.found = found
        # slopes of the arrival filter are taken where the window saw the sample that leaves
        self._before = found.plan.states[_FIRST].copy()
        self.vector = self.filter.within(newest)
        return self._told(filtered, status)

    def expected(self, inputs: Mapping[str, ArrayLike] | None = None) -> dict[str, Array]:
        """The predicted measurement of each signal at t, from the filter's estimate."""
        return self.filter.expected(inputs)

    def predict(self, inputs: Mapping[str, ArrayLike] | None = None) -> FilterStatus:
        """Predicts the state at t+1, with the inputs from t on."""
        status = self.filter.predict(inputs)
        if status in _REFUSED:
            return status
        self._data.give({name: np.asarray(v, float) for name, v in (inputs or {}).items()})
        self._learn_pasts()
        # a window whose first sample cannot be passed begins anew, with what the filter knows
        if self._data.is_full and not self._passes_first():
            self._arrival.take(self.filter)
            self._data.advance()
            self._data.count = 0
            self._method.forget(None)
        else:
            self._data.advance()
        self._before = None
        self.vector = self.filter.vector.copy()
        return status

    def residuals(self) -> Residuals:
        """Residuals of the last window's optimality conditions, independent of the solver.

        ValueError where nothing was solved.
        """
        if self.given is None or self.found is None:
            raise ValueError("no window was solved")
        return Judge(self.control).residuals(self.given, self.found.plan, self.found.multipliers)

    def casadi(
        self, solver: Literal["ipopt", "fatrop"] = "ipopt", options: Mapping[str, Any] | None = None
    ) -> OptimalControlNlp:
        """The problem of a window for a solver of CasADi, to compare with.

        nlp = estimator.casadi()
        print(nlp.solve(estimator.given, estimator.found.plan).cost, found.cost)
        """
        from msnn.features.control.casadi.optimal_control import OptimalControlNlp

        return OptimalControlNlp(self.control, solver, options)

    # ---- inside

    def _passes_first(self) -> bool:
        """Updates the arrival filter by the sample that leaves the window."""
        measured, inputs = self._data.samples_at(_FIRST)
        found = self._arrival.correct(measured, inputs, around=self._before)
        status = self._arrival.predict(inputs, around=self._before)
        return found.status is FilterStatus.FILTERED and status is FilterStatus.FILTERED

    def _learn_pasts(self) -> None:
        """Updates the registers of past samples that the first inputs have filled."""
        # only before the first step: later ones carry registers on themselves
        if self._data.count == 0 and not np.array_equal(
            self._arrival.is_known, self.filter.is_known
        ):
            # what the caller gave stays
            registers = [name for name in self.problem.registers if name not in self._x]
            values = by_name(self.numbers, self.filter.vector[None])
            known = by_name(self.numbers, self.filter.is_known[None])
            filled = {name: values[name][0] for name in registers if np.all(known[name])}
            self._arrival.reset(self._x | filled)

    def _told(self, filtered: Estimate, status: FilterStatus) -> WindowEstimate:
        found = self.found
        values = {
            name: value[0] for name, value in by_name(self.numbers, self.vector[None]).items()
        }
        own = self.problem.parameters
        cost = np.nan
        if found is not None and self.given is not None:
            limits = self._functions.limits(self.given)
            cost = self._functions.cost(limits, found.values)[0]
        return WindowEstimate(
            status=status,
            states={name: value for name, value in values.items() if name not in own},
            parameters={name: value for name, value in values.items() if name in own},
            std=filtered.std,
            innovations=filtered.innovations,
            cost=cost,
            residual=np.inf if found is None else found.residual,
            iterations=0 if found is None else found.iterations,
        )
