"""Estimates states and parameters by an extended Kalman filter."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from compiler.hessian.step_derivatives import DerivativeInterpreter, next_value, step_derivatives
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.nodes import reads_log
from compiler.ir.program import History, Tape
from compiler.ir.types import Type
from compiler.jacobian.matrices import Vector, by_name, vector_of
from msnn.features.control.problem.state_estimation import EstimationProblem, augmented


def deviations(
    problem: EstimationProblem, numbers: Vector, *, initial: bool
) -> NDArray[np.float64]:
    """The standard deviation of each element of ξ: the initial one, or that of the noise in one
    second. It is 0 for elements that are known. `numbers` is the layout of ξ.

    In the register of a fed-back signal, only the newest sample has noise.
    """
    found = np.zeros(numbers.size)
    table = {**problem.deviations, **problem.parameters}
    for member in numbers.members:
        if member.name in table:
            std = table[member.name].initial if initial else table[member.name].drift
            values = np.full(Type(member.axes).shape, std)
            if isinstance(problem.registers.get(member.name), Tape) and not initial:
                # what was fed back before was corrected before: noise is of the newest alone
                values[..., :-1] = 0.0
            found[member.first : member.first + member.size] = values.ravel()
    return found


Array = NDArray[Any]


class FilterStatus(IntEnum):
    """The outcome of a correction or prediction; equal outcomes of controllers have the same
    numbers.
    """

    FILTERED = 0
    """The estimate is that of the measurements."""
    CAPPED = 1
    """Of a moving horizon: its iterations ran out before the tolerance."""
    DIVERGED = 2
    """Something is not finite: the estimate is as it was; of a moving horizon, the filter's."""
    INPUT_NOT_FINITE = 3
    """An input is NaN, or anything given infinite: the estimate is as it was."""
    NOT_INITIALISED = 4
    """Some state has no initial value."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """The estimates at a sample, by name and in the units of the spec."""

    status: FilterStatus
    states: dict[str, Array]
    parameters: dict[str, Array]
    std: dict[str, Array]
    """Standard deviations of both."""
    innovations: dict[str, Array]
    """Measurement minus prediction, by signal; NaN without a measurement."""


@dataclass(frozen=True, slots=True)
class WindowEstimate(Estimate):
    """The estimate of moving-horizon estimation; `std` and `innovations` are those of the filter
    that runs in parallel.
    """

    cost: float
    """Of the window: squares of errors and noise, by their deviations; NaN without a solve."""
    residual: float
    """Largest error of the optimality conditions; ∞ without a solve."""
    iterations: int


def input_rows(
    problem: EstimationProblem, inputs: Mapping[str, ArrayLike], wanted: Collection[str]
) -> dict[str, NDArray[Any]]:
    """The rows of a log for one step, by input: (samples, *shape). Inputs that are not in `wanted`
    may be missing, and are then 0.

    Raises ValueError for an input that is missing, unknown or of another shape.
    """
    names = [member.name for member in problem.inputs.members]
    unknown = sorted({*inputs} - {*names})
    if unknown or not {*wanted} <= {*inputs}:
        message = f"inputs wanted for {sorted(wanted)}, given for {sorted(inputs)}"
        raise ValueError(message)
    log: dict[str, NDArray[Any]] = {}
    for member in problem.inputs.members:
        type = Type(member.axes)
        shape = type.shape
        array = np.asarray(inputs.get(member.name, np.zeros(shape)), float)
        if array.shape != shape:
            raise ValueError(f"`{member.name}` has shape {array.shape}, not {shape}")
        # the samples of a window are the rows of the log: a port's last axis goes first
        log[member.name] = array[None] if type.window is None else np.moveaxis(array, -1, 0)
    return log


class KalmanFilter:
    """The extended Kalman filter of a model, `msnn.estimator(model)`. It stores estimate and
    covariance from sample to sample.
    """

    def __init__(
        self,
        problem: EstimationProblem,
        weights: Mapping[str, ArrayLike],
        dtype: DTypeLike = np.float64,
    ) -> None:
        """`weights` has the physical value of each parameter, which is the initial estimate of
        estimated ones; `dtype` is the precision.
        """
        self.problem = problem
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        known = problem.program.parameters
        self._weights = {p.name: np.asarray(weights[p.name], float) for p in known}
        program = augmented(problem.program, problem.parameters)
        self.numbers = vector_of("x", [(s.name, s.axes, s.unit) for s in program.states])
        """ξ: states, then estimated parameters."""
        self._size = self.numbers.size
        # slopes by ξ alone: inputs are known, and have no variance
        self._derivatives = step_derivatives(program, inputs=(), hessian=False)
        self._judge = DerivativeInterpreter(self._derivatives, program, self._weights, self.dtype)
        self._columns = self._places()
        # a variance grows with time: by std² a second
        self.drift: Array = (
            deviations(problem, self.numbers, initial=False) ** 2 * problem.sample_time
        )
        self.covariance: Array = np.zeros((self._size, self._size), self.dtype)
        self.vector: Array = np.zeros(self._size, self.dtype)
        self._known: set[str] = set()
        self.reset()

    def reset(self, x: Mapping[str, ArrayLike] | None = None) -> None:
        """Restarts the filter from the states `x`, by name; other states have the initial value of
        the spec, if it needs no log.

        Elements that are not finite count as missing. Raises ValueError for an unknown name and
        another shape.
        """
        problem = self.problem
        program = problem.program
        self.vector = np.zeros(self._size, self.dtype)
        self.covariance = np.diag(deviations(problem, self.numbers, initial=True) ** 2).astype(
            self.dtype
        )
        # a start that reads the log cannot be evaluated online: such states wait to be given (R13)
        alone = [s for s in program.states if not reads_log(program.start, s.start)]
        # registers fill with the first sample that they are given, not with what `history` says
        alone = [state for state in alone if state.name not in problem.registers]
        start = Interpreter(replace(program, states=tuple(alone), outputs=()), self._weights)
        self._known = set()
        for name in problem.parameters:
            self._set(name, self._weights[name])
        for name, value in start.start({}, 0).items():
            self._set(name, value[0])
        for name, value in (x or {}).items():
            own, numbers = self._register(name, np.asarray(value, float))
            member = self.numbers.member(own)
            now = self.vector[member.first : member.first + member.size]
            given = np.isfinite(numbers)
            was_known = own in self._known
            self._set(own, np.where(given, numbers, now.reshape(numbers.shape)))
            if not (was_known or np.all(given)):
                self._known.discard(own)

    def correct(
        self,
        measured: Mapping[str, ArrayLike],
        inputs: Mapping[str, ArrayLike] | None = None,
        *,
        around: Array | None = None,
    ) -> Estimate:
        """Corrects the estimate by the measurements at t, by signal, and returns it; NaN is not
        measured.

        `inputs` at t are required if measured outputs depend on them. Derivatives are taken at
        `around`, a vector ξ, by default at the estimate. A correction that fails is reported in the
        status, and the estimate is unchanged. Raises ValueError for a missing input, an unknown
        name and another shape.
        """
        problem = self.problem
        known = {m.signal: m for m in problem.measured}
        unknown = sorted({*measured} - {*known})
        if unknown:
            raise ValueError(f"measured signals are {sorted(known)}, given are {unknown} too")
        log = self._log(inputs or {}, self.problem.inputs_measured)
        given = {name: np.asarray(value, float) for name, value in measured.items()}
        # NaN says not measured; ∞ says that a sensor is broken
        if any(np.any(np.isinf(v)) for v in given.values()) or _is_not_finite(log):
            return self._told(FilterStatus.INPUT_NOT_FINITE, {})
        if not self._is_complete:
            return self._told(FilterStatus.NOT_INITIALISED, {})
        # copies: where something is not finite at last, the estimate is as it was
        vector, covariance = self.vector.copy(), self.covariance.copy()
        innovations: dict[str, Array] = {}
        for name, value in given.items():
            measurement = known[name]
            point = vector if around is None else around
            expected, slopes = self._expected(measurement.value, log, point)
            if around is not None:
                # the measurement as it is at `around`, carried over to the estimate by its slopes
                expected = expected + (slopes @ (vector - around)).reshape(expected.shape)
            if value.shape != expected.shape:
                raise ValueError(f"`{name}` has shape {value.shape}, not {expected.shape}")
            innovations[name] = value - expected
            variance = self.dtype.type(measurement.std**2)
            before = vector
            for number, row in zip(innovations[name].ravel(), slopes, strict=True):
                if not np.isnan(number):
                    # what numbers of the same measurement before it have moved already
                    rest = self.dtype.type(number) - row @ (vector - before)
                    gain, covariance = _joseph(covariance, row, variance)
                    vector = vector + gain * rest
        # at the end, not after each number: the corrections of one sample belong together
        vector = self.within(vector)
        if not (np.all(np.isfinite(vector)) and np.all(np.isfinite(covariance))):
            return self._told(FilterStatus.DIVERGED, innovations)
        self.vector, self.covariance = vector, covariance
        return self._told(FilterStatus.FILTERED, innovations)

    def expected(self, inputs: Mapping[str, ArrayLike] | None = None) -> dict[str, Array]:
        """The predicted measurement of each signal at t, from the estimate. `inputs` as for
        `correct`.
        """
        log = self._log(inputs or {}, self.problem.inputs_measured)
        known = self.problem.measured
        return {m.signal: self._expected(m.value, log, self.vector)[0] for m in known}

    def predict(
        self, inputs: Mapping[str, ArrayLike] | None = None, *, around: Array | None = None
    ) -> FilterStatus:
        """Predicts the estimate at t+1, with the inputs that act from t on; `around` as for
        `correct`. Returns the status; if it is not FILTERED, the estimate is unchanged. Raises
        ValueError for wrong inputs.
        """
        log = self._log(inputs or {}, {m.name for m in self.problem.inputs.members})
        if _is_not_finite(log):
            return FilterStatus.INPUT_NOT_FINITE
        if not self._is_complete:
            return FilterStatus.NOT_INITIALISED
        point = self.vector if around is None else around
        results, jacobian = self._evaluated(log, point)
        names = [next_value(member.name) for member in self.numbers.members]
        transition = jacobian[self._rows(names)]
        vector = np.concatenate([*(np.ravel(results[name]) for name in names), np.empty(0)])
        # F(around) + A (ξ − around): the window solved for what F is linear about
        if around is not None:
            vector = vector + transition @ (self.vector - around)
        covariance = transition @ self.covariance @ transition.T
        # rounding lets the triangles drift apart, sample after sample
        covariance = (covariance + covariance.T) / 2 + np.diag(self.drift).astype(self.dtype)
        if not (np.all(np.isfinite(vector)) and np.all(np.isfinite(covariance))):
            return FilterStatus.DIVERGED
        self.vector = self.within(vector.astype(self.dtype))
        self.covariance = covariance
        return FilterStatus.FILTERED

    def within(self, vector: Array) -> Array:
        """A copy of a vector ξ with its parameters clipped to their limits."""
        found = vector.copy()
        for name, numbers in self.problem.parameters.items():
            member = self.numbers.member(name)
            part = slice(member.first, member.first + member.size)
            low = -np.inf if numbers.minimum is None else numbers.minimum
            high = np.inf if numbers.maximum is None else numbers.maximum
            found[part] = np.clip(found[part], low, high)
        return found

    def take(self, other: KalmanFilter) -> None:
        """Copies the estimate and covariance of another filter of the same problem."""
        self.vector, self.covariance = other.vector.copy(), other.covariance.copy()
        self._known = {*other._known}

    # ---- inside

    @property
    def is_known(self) -> NDArray[np.bool_]:
        """True for the elements of ξ that have been initialised."""
        parts = [np.full(m.size, m.name in self._known) for m in self.numbers.members]
        return np.concatenate([*parts, np.empty(0, np.bool_)])

    @property
    def _is_complete(self) -> bool:
        return bool(np.all(self.is_known))

    def _places(self) -> NDArray[np.int64]:
        """The index of each element of ξ among the variables of the derivatives."""
        known = self._derivatives.variables
        parts = [np.arange(m.size) + known.member(m.name).first for m in self.numbers.members]
        return np.concatenate([*parts, np.empty(0, int)]).astype(np.int64)

    def _rows(self, names: list[str]) -> NDArray[np.int64]:
        members = [self._derivatives.results.member(name) for name in names]
        parts = [np.arange(member.size) + member.first for member in members]
        return np.concatenate([*parts, np.empty(0, int)]).astype(np.int64)

    def _evaluated(self, log: Mapping[str, Array], vector: Array) -> tuple[dict[str, Array], Array]:
        """The results of a step at the vector ξ, by name, and their Jacobian with respect to ξ."""
        found = self._judge.values(log, 0, by_name(self.numbers, vector[None]))
        results = {name: value[0] for name, value in found.results.items()}
        return results, found.matrices["J"][0][:, self._columns]

    def _expected(self, value: str, log: Mapping[str, Array], vector: Array) -> tuple[Array, Array]:
        results, jacobian = self._evaluated(log, vector)
        return results[value], jacobian[self._rows([value])]

    def _log(self, inputs: Mapping[str, ArrayLike], wanted: Collection[str]) -> dict[str, Array]:
        """The rows of `input_rows`; also fills registers of inputs that have no value yet."""
        problem = self.problem
        log = input_rows(problem, inputs, wanted)
        for name, origin in problem.registers.items():
            if name in self._known or not isinstance(origin, History):
                continue
            # a register of an input fills with its first sample at every place (R13)
            if origin.source in inputs and np.all(np.isfinite(log[origin.source][0])):
                self._set(name, np.repeat(log[origin.source][0][..., None], self._length(name), -1))
        return log

    def _length(self, register: str) -> int:
        return self.problem.states.member(register).axes[-1].size

    def _register(self, name: str, value: Array) -> tuple[str, Array]:
        """The state that a name means, and its value: a fed-back signal means its register, which
        repeats the value. Raises ValueError for an unknown name and another shape.
        """
        tapes = {
            origin.signal: register
            for register, origin in self.problem.registers.items()
            if isinstance(origin, Tape)
        }
        if name in tapes:
            name = tapes[name]
            value = np.repeat(value[..., None], self._length(name), -1)
        if all(member.name != name for member in self.numbers.members):
            raise ValueError(f"no state or fed-back signal `{name}`")
        shape = Type(self.numbers.member(name).axes).shape
        if value.shape != shape:
            raise ValueError(f"`{name}` has shape {value.shape}, not {shape}")
        return name, value

    def _set(self, name: str, value: Array) -> None:
        member = self.numbers.member(name)
        self.vector[member.first : member.first + member.size] = value.ravel()
        self._known.add(name)

    def _told(self, status: FilterStatus, innovations: dict[str, Array]) -> Estimate:
        # below 0 only by rounding
        std = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        found, deviations = (
            {name: value[0] for name, value in by_name(self.numbers, v[None]).items()}
            for v in (self.vector, std)
        )
        own = self.problem.parameters
        return Estimate(
            status=status,
            states={name: value for name, value in found.items() if name not in own},
            parameters={name: value for name, value in found.items() if name in own},
            std=deviations,
            innovations=innovations,
        )


def _joseph(covariance: Array, row: Array, variance: Any) -> tuple[Array, Array]:
    """The Kalman gain of one scalar measurement with the Jacobian `row` and the noise `variance`,
    and the covariance after it (Joseph form).
    """
    gain: Array = covariance @ row
    # one number at a time, so that s is a number and no system is to be solved
    gain = gain / (row @ gain + variance)
    keep: Array = np.eye(len(row), dtype=covariance.dtype) - np.outer(gain, row)
    after: Array = keep @ covariance @ keep.T + variance * np.outer(gain, gain)
    # as in `predict`: both triangles stay equal
    return gain, (after + after.T) / 2


def _is_not_finite(log: Mapping[str, Array]) -> bool:
    return any(not np.all(np.isfinite(value)) for value in log.values())
