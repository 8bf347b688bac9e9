"""Estimates states and parameters by moving-horizon estimation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiler.ir.types import Type
from compiler.jacobian.matrices import by_name
from msnn.features.control.kalman_filter import Estimate, FilterStatus, KalmanFilter, WindowEstimate
from msnn.features.control.problem.horizon import Array, Given
from msnn.features.control.problem.kkt import Judge, Residuals
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.state_estimation import EstimationProblem
from msnn.features.control.problem.trained import trained_window
from msnn.features.control.problem.window_problem import (
    RUNS,
    SPREAD,
    STARTS,
    WindowProblem,
    window_problem,
)
from msnn.features.control.run.control_range import ControlRange
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.method import Found, Method, Status

if TYPE_CHECKING:
    from msnn.features.control.casadi.control_program import OptimalControlNlp


_Matrix = NDArray[Any]
_KNOWN = 1e-13
"""Relative conditional variance below which the remainder is rounding."""


def spread_of(covariance: _Matrix, uncertain: Sequence[int]) -> _Matrix:
    """S (n, uncertain) with S Sᵀ = P for a covariance P (n, n); `uncertain` are the indices of its
    uncertain elements.

    P = U D Uᵀ, column by column from the last on, with an upper triangular U and a diagonal D; S =
    U √D. Columns whose D is rounding are 0.
    """
    rest = np.array(covariance, float)
    size = len(rest)
    found = np.zeros((size, size))
    whole = np.diagonal(rest).copy()
    # from the last number on, so that what a number shares with those behind it is taken off first
    for j in range(size - 1, -1, -1):
        variance = rest[j, j]
        # not above, also where it is NaN: what rounding leaves of a variance is no uncertainty
        if not variance > _KNOWN * whole[j]:
            continue
        found[: j + 1, j] = rest[: j + 1, j] / np.sqrt(variance)
        # what this column explains of the numbers before it
        rest[: j + 1, : j + 1] -= np.outer(found[: j + 1, j], found[: j + 1, j])
    return found[:, list(uncertain)]


class WindowData:
    """The samples of an estimation window, as references of its control problem: the newest sample
    is the last row. The window grows until it is full.
    """

    def __init__(self, window: WindowProblem) -> None:
        self._window = window
        self._last = window.control.horizon
        self.count = 0
        """Steps from the window's first sample to its newest."""
        self.references: dict[str, Array] = {}
        for member in window.control.references.members:
            rows = self._last + 1 if member.name in window.control.previewed else 1
            self.references[member.name] = np.zeros((rows, *Type(member.axes).shape))
        self._is_given = False

    @property
    def is_full(self) -> bool:
        return self.count == self._last - 1

    @property
    def first(self) -> int:
        """The stage of the window's first sample."""
        return self._last - self.count

    def measure(self, measured: Mapping[str, Array]) -> None:
        """Stores the measurements of the newest sample, by signal; NaN marks missing elements."""
        for signal, value in measured.items():
            seen = ~np.isnan(value)
            kept = self.references[self._window.measured(signal)]
            # a number that is measured twice keeps the newer value
            kept[-1] = np.where(seen, value, kept[-1])
            marks = self.references[self._window.seen(signal)]
            marks[-1] = np.where(seen, 1.0, marks[-1])

    def fresh(self, measured: Mapping[str, ArrayLike]) -> dict[str, Array]:
        """The measurements with NaN for elements that were already measured at the
        newest sample.
        """
        found = {name: np.asarray(value, float) for name, value in measured.items()}
        for name, value in found.items():
            marks = self.references.get(self._window.seen(name))
            # names and shapes that are wrong, and what is infinite, are for the filter to refuse
            if marks is not None and marks[-1].shape == value.shape:
                found[name] = np.where((marks[-1] > 0) & np.isfinite(value), np.nan, value)
        return found

    def give(self, inputs: Mapping[str, Array]) -> None:
        """Stores inputs of the newest sample, by name; the first ones are also used for all earlier
        samples.
        """
        for name, value in inputs.items():
            kept = self.references[self._window.inputs[name]]
            # stages before the window's first sample are evaluated too, and need inputs that are
            # finite
            kept[-1 if self._is_given else slice(None)] = value
        self._is_given = self._is_given or bool(inputs)

    def samples_at(self, stage: int) -> tuple[dict[str, Array], dict[str, Array]]:
        """The measurements at a stage by signal, NaN where nothing was measured, and its inputs by
        name.
        """
        measured: dict[str, Array] = {}
        for name in self._window.signals:
            seen = self.references[self._window.seen(name)][stage] > 0
            value = self.references[self._window.measured(name)][stage]
            measured[name] = np.where(seen, value, np.nan)
        known = self._window.inputs.items()
        return measured, {name: self.references[own][stage] for name, own in known}

    def advance(self) -> None:
        """Moves the window by one sample; the new sample has no measurements, and the inputs of the
        previous one.
        """
        # previewed references are the samples; the others are of the whole window
        for name, values in self.references.items():
            if name in self._window.control.previewed:
                values[:-1] = values[1:].copy()
        for name in self._window.signals:
            self.references[self._window.measured(name)][-1] = 0.0
            self.references[self._window.seen(name)][-1] = 0.0
        # once full, the window keeps its length and moves
        self.count = min(self.count + 1, self._last - 1)

    def begin(self, spread: Array) -> None:
        """Marks the first stage of the window, and sets `spread`, the square root of the covariance
        of its initial state.
        """
        stages = np.arange(self._last + 1)
        # ξ_0 = x̄ + S v is the step from the stage before the first sample
        self.references[STARTS][:] = stages == self.first - 1
        self.references[RUNS][:] = stages >= self.first
        self.references[SPREAD][0] = spread


_OF_SOLVES = {Status.SOLVED: FilterStatus.FILTERED, Status.CAPPED: FilterStatus.CAPPED}
_REFUSED = (FilterStatus.INPUT_NOT_FINITE, FilterStatus.NOT_INITIALISED)
_FIRST = 1
"""The stage of a full window's first sample; the one before it starts there."""


class MovingHorizon:
    """The moving-horizon estimator of an `mhe` section, `msnn.estimator(model)`. It stores a window
    of samples, and runs a Kalman filter in parallel.
    """

    def __init__(
        self,
        problem: EstimationProblem,
        weights: Mapping[str, ArrayLike],
        method: Callable[[ControlProblem, HorizonFunctions], Method],
    ) -> None:
        """`method` makes the solver of the window's problem; `weights` has the physical value of
        each parameter.
        """
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
        """Restarts the estimator from the states `x`, by name; other states have the initial value
        of the spec, if it needs no log. Raises ValueError for an unknown name and another shape.
        """
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
        """The estimate at t, from the measurements at t, by signal, and in the window; NaN is not
        measured.

        `inputs` at t are required if measured outputs depend on them. If the window cannot be
        solved, the estimate is that of the filter. Raises ValueError for a missing input, an
        unknown name and another shape.
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
        """The predicted measurement of each signal at t, from the filter's estimate. `inputs` as
        for `correct`.
        """
        return self.filter.expected(inputs)

    def predict(self, inputs: Mapping[str, ArrayLike] | None = None) -> FilterStatus:
        """Predicts the states at t+1, with the inputs that act from t on; returns the status of the
        filter. Raises ValueError for wrong inputs.
        """
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
        """The residuals of the last window's optimality conditions, computed independently of the
        solver.

        Raises ValueError if no window was solved.
        """
        if self.given is None or self.found is None:
            raise ValueError("no window was solved")
        return Judge(self.control).residuals(self.given, self.found.plan, self.found.multipliers)

    def casadi(
        self, solver: Literal["ipopt", "fatrop"] = "ipopt", options: Mapping[str, Any] | None = None
    ) -> OptimalControlNlp:
        """The problem of a window for a solver of CasADi, for comparisons; `options` are passed to
        it. Raises ImportError without CasADi.

            nlp = estimator.casadi()
            print(nlp.solve(estimator.given, estimator.found.plan).cost, found.cost)
        """
        from msnn.features.control.casadi.control_program import OptimalControlNlp

        return OptimalControlNlp(self.control, solver, options)

    # ---- inside

    def _passes_first(self) -> bool:
        """Updates the arrival filter, which estimates the start of the window, by the sample that
        leaves the window. False if it fails.
        """
        measured, inputs = self._data.samples_at(_FIRST)
        found = self._arrival.correct(measured, inputs, around=self._before)
        status = self._arrival.predict(inputs, around=self._before)
        return found.status is FilterStatus.FILTERED and status is FilterStatus.FILTERED

    def _learn_pasts(self) -> None:
        """Copies shift registers that the first inputs have filled to the arrival filter."""
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
