"""Calls a generated filter from numpy: its structs and the functions of its built library."""

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
    """The estimate that a correction gave."""

    status: int
    x: Array
    std: Array
    innovation: Array
    residual: float
    """Of a window; a filter has none, 0."""
    iterations: int | None
    """Of a window; a filter has none."""


class FilterLibrary:
    """One filter; `about` is what the JSON file beside the sources says."""

    def __init__(self, about: Mapping[str, Any], library: ctypes.CDLL) -> None:
        self._prefix: str = about["prefix"]
        self._library = library
        self._inputs = {field["signal"]: field["name"] for field in about["in"]}
        self._signals = {field["signal"]: field["name"] for field in about["measured"]}
        # numpy's structured types, aligned as C aligns them, are the memory of the filter
        self._state = np.zeros(1, struct_type(about["struct"]))
        self._in = np.zeros(1, struct_type(about["in"]))
        self._measured = np.zeros(1, struct_type(about["measured"]))
        self._out = np.zeros(1, struct_type(about["out"]))
        self._call("init", self._state)

    @classmethod
    def of_folder(cls, folder: Path, library: Path) -> FilterLibrary:
        """A filter of what `write_estimator` wrote and `build_library` compiled."""
        # one of the two: a folder with both would not say which filter is meant
        (file,) = [*folder.glob("*_ekf.json"), *folder.glob("*_mhe.json")]
        return cls(json.loads(file.read_text(encoding="utf-8")), ctypes.CDLL(str(library)))

    @property
    def covariance(self) -> Array:
        """U D Uᵀ, multiplied in double precision."""
        # U has ones on its diagonal, where D is kept
        factor = self._state[0]["factor"].astype(float)
        upper = np.triu(factor, 1) + np.eye(len(factor))
        return (upper * np.diagonal(factor)) @ upper.T

    @property
    def variances(self) -> Array:
        """D."""
        return np.diagonal(self._state[0]["factor"]).copy()

    def reset(self, states: ArrayLike) -> None:
        """Begins anew from these states; NaN is as the spec says."""
        # of the type that the C has: ctypes passes an address, and checks nothing
        given = np.ascontiguousarray(states, self._out.dtype["x"].base)
        self._call("reset", self._state, given)

    def correct(
        self, measured: Mapping[str, ArrayLike], inputs: Mapping[str, ArrayLike] | None = None
    ) -> FilterEstimate:
        """The estimate; signals that are not named are not measured."""
        # NaN is "not measured" in the C too: the filter skips that row and keeps its innovation NaN
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
        """Goes on to the next sample."""
        self._fill(self._in, self._inputs, inputs)
        return self._call("predict", self._state, *([self._in] if self._inputs else []))

    def correct_numbers(self, measured: ArrayLike, given: ArrayLike) -> FilterEstimate:
        """The same by numbers in the order of the measurements and of all inputs."""
        inputs = self._by_signal(self._in, self._inputs, given)
        beside = {name: inputs[name] for name in self._signals if name in inputs}
        own = {name: field for name, field in self._signals.items() if name not in beside}
        return self.correct(self._by_signal(self._measured, own, measured), beside)

    def predict_numbers(self, given: ArrayLike) -> int:
        """The same by numbers in the order of all inputs."""
        return self.predict(self._by_signal(self._in, self._inputs, given))

    def selftest(self) -> int:
        """Bits of the self-test; 0 if all is well."""
        return self._call("selftest")

    def _by_signal(
        self, struct: Array, names: Mapping[str, str], numbers: ArrayLike
    ) -> dict[str, Array]:
        found: dict[str, Array] = {}
        rest = np.ravel(numbers)
        for signal, field in names.items():
            size = int(np.prod(struct.dtype[field].shape, dtype=int))
            found[signal], rest = rest[:size], rest[size:]
        return found

    def _fill(
        self, struct: Array, names: Mapping[str, str], values: Mapping[str, ArrayLike]
    ) -> None:
        for signal, field in names.items():
            shape = struct.dtype[field].shape
            struct[0][field] = np.asarray(values[signal], struct.dtype[field].base).reshape(shape)

    def _call(self, name: str, *arrays: Array) -> int:
        function = getattr(self._library, f"{self._prefix}_{name}")
        function.restype = ctypes.c_int
        return int(function(*(ctypes.c_void_p(array.ctypes.data) for array in arrays)))
