"""Calls the compiled library of a generated estimator from Python with numpy arrays (ctypes)."""

from __future__ import annotations

import ctypes
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msnn.features.control.backend.library import struct_type

Array = NDArray[Any]


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
        """Loads an estimator that `write_estimator` wrote and `build_library` compiled."""
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
        """Predicts the estimate of the next sample from these inputs; returns a status code."""
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
        """Splits a flat array into the fields of a struct, by signal."""
        values: dict[str, Array] = {}
        rest = np.ravel(numbers)
        for signal, field in names.items():
            size = int(np.prod(struct.dtype[field].shape, dtype=int))
            values[signal], rest = rest[:size], rest[size:]
        return values

    def _fill(
        self, struct: Array, names: Mapping[str, str], values: Mapping[str, ArrayLike]
    ) -> None:
        """Copies values by signal into the fields of a struct."""
        for signal, field in names.items():
            shape = struct.dtype[field].shape
            struct[0][field] = np.asarray(values[signal], struct.dtype[field].base).reshape(shape)

    def _call(self, name: str, *arrays: Array) -> int:
        """Calls `<prefix>_<name>` with pointers to the arrays; returns its int result."""
        function = getattr(self._library, f"{self._prefix}_{name}")
        function.restype = ctypes.c_int
        return int(function(*(ctypes.c_void_p(array.ctypes.data) for array in arrays)))
