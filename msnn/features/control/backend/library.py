"""Calls the compiled library of a generated controller from Python with numpy arrays (ctypes)."""

from __future__ import annotations

import ctypes
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Decision:
    """The output struct of a solve: status code, controls (nu), KKT residual and iterations."""

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
        """Loads a controller that `write_controller` wrote and `build_library` compiled."""
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
