"""Compiles generated controllers and estimators, and calls them with numpy arrays (ctypes)."""

from __future__ import annotations

import ctypes
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.files.c_compiler import CompilerMissingError
from backends.native.compile_kernel import KernelBuildError, compiled_kernel
from backends.native.native_step import one_text
from msnn.features.control.backend.structure.rows import Rows
from msnn.features.control.problem.horizon import Multipliers, Plan, stages_of
from msnn.features.control.problem.optimal_control import ControlProblem

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Decision:
    """The output struct of a solve: status code (0 if solved), controls (nu), KKT residual and
    iterations.
    """

    status: int
    control: Array
    residual: float
    iterations: int


class ControllerLibrary:
    """One instance of a generated controller.

    `about` is the parsed JSON description written next to the C sources.
    """

    def __init__(self, about: Mapping[str, Any], library: ctypes.CDLL) -> None:
        self._prefix: str = about["prefix"]
        self._plan: dict[str, Any] = about["plan"]
        self._horizon: int = about["horizon"]
        self.cost_scale: float = about["cost_scale"]
        """Factor by which the solver multiplies the cost of the spec."""
        self._library = library
        self._state = np.zeros(1, struct_type(about["struct"]))
        self._in = np.zeros(1, struct_type(about["in"]))
        self._out = np.zeros(1, struct_type(about["out"]))
        self.init()

    @classmethod
    def of_folder(cls, folder: Path, library: Path) -> ControllerLibrary:
        """Loads a controller that `write_controller` wrote to `folder` and `build_library` compiled
        to `library`. Raises ValueError if the folder has no controller or several.
        """
        (file,) = folder.glob("*_mpc.json")
        return cls(json.loads(file.read_text(encoding="utf-8")), ctypes.CDLL(str(library)))

    @property
    def real(self) -> np.dtype[np.floating[Any]]:
        """The floating-point type of the controller, float32 or float64."""
        return self._in.dtype["x"].base

    def init(self) -> None:
        """Initialises the controller: without a plan, controls at rest."""
        self._call("init", self._state)

    def reset(self, control: ArrayLike) -> None:
        """Initialises the controller with the controls (nu) that the plant currently receives."""
        self._call("reset", self._state, np.ascontiguousarray(control, self._in.dtype["x"].base))

    def solve(self, values: Mapping[str, ArrayLike]) -> Decision:
        """Solves for the controls of this sample.

        `values` has `x` and the disturbances and references along the horizon, by field name.
        """
        return self._decided("solve", values)

    def prepare(self) -> None:
        """Runs the preparation phase of an iteration, which needs no measurement."""
        self._call("prepare", self._state)

    def feedback(self, values: Mapping[str, ArrayLike]) -> Decision:
        """Returns the controls from the prepared iteration; `values` as for `solve`."""
        return self._decided("feedback", values)

    def selftest(self) -> int:
        """Runs the generated self-test; returns a bit mask of failures, 0 if it passes."""
        return self._call("selftest")

    def member(self, name: str) -> Array:
        """Returns a copy of a member of the controller's state struct."""
        return self._state[0][name].copy()

    def plan(self) -> Array:
        """Returns the plan (x, u), (N+1, nx+nu); the controls of stage N are meaningless."""
        at = np.asarray(self._plan["places"])
        stages = self._plan["step"] * np.arange(self._horizon + 1)
        # the layout depends on the structure of the solver (`PlanLayout`)
        return self._state[0]["z"].ravel()[stages[:, None] + at]

    def _decided(self, function: str, values: Mapping[str, ArrayLike]) -> Decision:
        """Fills the input struct, calls the C function and copies the output struct."""
        for name, value in values.items():
            self._in[0][name] = np.asarray(value).reshape(self._in.dtype[name].shape)
        status = self._call(function, self._state, self._in, self._out)
        output = self._out[0]
        return Decision(
            status, output["u"].copy(), float(output["residual"]), int(output["iterations"])
        )

    def _call(self, name: str, *arrays: Array) -> int:
        """Calls `<prefix>_<name>` with pointers to the arrays; returns its int result."""
        function = getattr(self._library, f"{self._prefix}_{name}")
        function.restype = ctypes.c_int
        return int(function(*(ctypes.c_void_p(array.ctypes.data) for array in arrays)))


def struct_type(members: list[dict[str, Any]]) -> np.dtype[Any]:
    """Returns the numpy type of a C struct, from the name, type and shape of each member."""
    fields = [(m["name"], np.dtype(m["type"]), tuple(m["shape"])) for m in members]
    # C compilers align each member to a multiple of its element size
    return np.dtype(fields, align=True)


def plan_of(problem: ControlProblem, library: ControllerLibrary) -> Plan:
    """Returns the states (N+1, nx) and controls (N, nu) of the last solve."""
    nx, n = problem.states.size, problem.horizon
    z = library.plan().astype(np.float64)
    return Plan(z[:, :nx], z[:n, nx:])


def multipliers_of(problem: ControlProblem, rows: Rows, library: ControllerLibrary) -> Multipliers:
    """Returns the multipliers of all limits at the last solve, for the cost of the spec."""
    n, nu = problem.horizon, problem.controls.size
    live = library.member("live") != 0
    # a control with no room between its limits is held by both
    live[:, : 2 * nu] |= np.repeat(library.member("room") == 0, 2, axis=1)
    sides = np.where(live, library.member("multiplier").astype(np.float64), 0.0)
    # the solver scales the cost, and the multipliers with it
    sides = sides / library.cost_scale
    # sides alternate: minimum, maximum
    low, high = sides[:, 0::2], sides[:, 1::2]
    rate_low, rate_high = np.zeros((n, nu)), np.zeros((n, nu))
    for number, rate in enumerate(rows.rates):
        rate_low[:, rate.control] = low[:n, nu + number]
        rate_high[:, rate.control] = high[:n, nu + number]
    first = nu + len(rows.rates)
    places: dict[str, slice] = {}
    for path in rows.paths:
        size = problem.type(path.value).size
        places[path.value] = slice(first, first + size)
        first += size
    paths = [(stages_of(problem, path), places[path.value]) for path in problem.path_limits]
    return Multipliers(
        control_min=low[:n, :nu],
        control_max=high[:n, :nu],
        rate_min=rate_low,
        rate_max=rate_high,
        path_min=tuple(low[stages, rows_] for stages, rows_ in paths),
        path_max=tuple(high[stages, rows_] for stages, rows_ in paths),
    )


@dataclass(frozen=True, slots=True)
class FilterEstimate:
    """Result of a correction: estimate and standard deviations (n), innovations, status code."""

    status: int
    x: Array
    std: Array
    innovation: Array
    residual: float
    """KKT residual of a moving-horizon estimator; 0 for a Kalman filter."""
    iterations: int | None
    """Iterations of a moving-horizon estimator; None for a Kalman filter."""


class FilterLibrary:
    """One instance of a generated Kalman filter or moving-horizon estimator.

    `about` is the parsed JSON description written next to the C sources.
    """

    def __init__(self, about: Mapping[str, Any], library: ctypes.CDLL) -> None:
        self._prefix: str = about["prefix"]
        self._library = library
        self._inputs = {field["signal"]: field["name"] for field in about["in"]}
        self._signals = {field["signal"]: field["name"] for field in about["measured"]}
        # structured numpy arrays with the layout of the C structs
        self._state = np.zeros(1, struct_type(about["struct"]))
        self._in = np.zeros(1, struct_type(about["in"]))
        self._measured = np.zeros(1, struct_type(about["measured"]))
        self._out = np.zeros(1, struct_type(about["out"]))
        self._call("init", self._state)

    @classmethod
    def of_folder(cls, folder: Path, library: Path) -> FilterLibrary:
        """Loads an estimator that `write_estimator` wrote to `folder` and `build_library` compiled
        to `library`. Raises ValueError if the folder has no estimator or several.
        """
        # exactly one: with both, the choice would be ambiguous
        (file,) = [*folder.glob("*_ekf.json"), *folder.glob("*_mhe.json")]
        return cls(json.loads(file.read_text(encoding="utf-8")), ctypes.CDLL(str(library)))

    @property
    def covariance(self) -> Array:
        """The covariance P = U D Uᵀ (n, n), multiplied in float64."""
        # U has a unit diagonal; the array stores D there
        factor = self._state[0]["factor"].astype(float)
        upper = np.triu(factor, 1) + np.eye(len(factor))
        return (upper * np.diagonal(factor)) @ upper.T

    @property
    def variances(self) -> Array:
        """The diagonal of D (n) in P = U D Uᵀ."""
        return np.diagonal(self._state[0]["factor"]).copy()

    def reset(self, states: ArrayLike) -> None:
        """Restarts the estimator from these states; NaN takes the initial value of the spec."""
        # converted to the C type: ctypes passes an address and checks nothing
        initial = np.ascontiguousarray(states, self._out.dtype["x"].base)
        self._call("reset", self._state, initial)

    def correct(
        self, measured: Mapping[str, ArrayLike], inputs: Mapping[str, ArrayLike] | None = None
    ) -> FilterEstimate:
        """Corrects the estimate by the measurements of this sample, by signal, and returns it.

        Omitted signals and NaN are not measured. `inputs` has those that measured outputs read.
        """
        # the C, too, skips a NaN and sets its innovation to NaN
        missing = {
            signal: np.full(self._measured.dtype[field].shape, np.nan)
            for signal, field in self._signals.items()
        }
        known = {**missing, **measured, **(inputs or {})}
        self._fill(self._measured, self._signals, known)
        status = self._call("correct", self._state, self._measured, self._out)
        out = self._out[0]
        is_window = "residual" in (self._out.dtype.names or ())
        return FilterEstimate(
            status=status,
            x=out["x"].copy(),
            std=out["std"].copy(),
            innovation=out["innovation"].copy(),
            residual=float(out["residual"]) if is_window else 0.0,
            iterations=int(out["iterations"]) if is_window else None,
        )

    def predict(self, inputs: Mapping[str, ArrayLike]) -> int:
        """Predicts the estimate of the next sample from the inputs of this one, by signal; returns
        a status code. Raises KeyError for a missing input.
        """
        self._fill(self._in, self._inputs, inputs)
        return self._call("predict", self._state, *([self._in] if self._inputs else []))

    def correct_numbers(self, measured: ArrayLike, given: ArrayLike) -> FilterEstimate:
        """Corrects as `correct` does, from flat arrays of all measured elements and all inputs.

        They are in the order of the measurements and of the inputs.
        """
        inputs = self._by_signal(self._in, self._inputs, given)
        read = {name: inputs[name] for name in self._signals if name in inputs}
        own = {name: field for name, field in self._signals.items() if name not in read}
        return self.correct(self._by_signal(self._measured, own, measured), read)

    def predict_numbers(self, given: ArrayLike) -> int:
        """Predicts as `predict` does; the argument is all inputs, flattened, in their order."""
        return self.predict(self._by_signal(self._in, self._inputs, given))

    def selftest(self) -> int:
        """Runs the generated self-test; returns a bit mask of failures, 0 if it passes."""
        return self._call("selftest")

    def _by_signal(
        self, struct: Array, names: Mapping[str, str], numbers: ArrayLike
    ) -> dict[str, Array]:
        """Splits a flat array into the fields of a struct, by signal; `names` maps signals to
        fields.
        """
        values: dict[str, Array] = {}
        rest = np.ravel(numbers)
        for signal, field in names.items():
            size = int(np.prod(struct.dtype[field].shape, dtype=int))
            values[signal], rest = rest[:size], rest[size:]
        return values

    def _fill(
        self, struct: Array, names: Mapping[str, str], values: Mapping[str, ArrayLike]
    ) -> None:
        """Copies `values`, by signal, into the fields of a struct; `names` maps signals to fields.
        Raises KeyError for a missing signal.
        """
        for signal, field in names.items():
            shape = struct.dtype[field].shape
            struct[0][field] = np.asarray(values[signal], struct.dtype[field].base).reshape(shape)

    def _call(self, name: str, *arrays: Array) -> int:
        """Calls `<prefix>_<name>` with pointers to the arrays; returns its int result."""
        function = getattr(self._library, f"{self._prefix}_{name}")
        function.restype = ctypes.c_int
        return int(function(*(ctypes.c_void_p(array.ctypes.data) for array in arrays)))


def compiled_texts(texts: Mapping[str, str]) -> ctypes.CDLL | None:
    """Compiles C files, given by path, and loads the library; returns None without a working C
    compiler.
    """
    try:
        return compiled_kernel(one_text(texts), briefly=True).library
    except (CompilerMissingError, KernelBuildError):
        return None
