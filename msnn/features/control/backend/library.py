"""Calls a generated controller from numpy: its structs and the functions of its built library."""

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
    """The result of a solve."""

    status: int
    control: Array
    residual: float
    iterations: int


class ControllerLibrary:
    """One controller; `about` is what the JSON file beside the sources says."""

    def __init__(self, about: Mapping[str, Any], library: ctypes.CDLL) -> None:
        self._prefix: str = about["prefix"]
        self._plan: dict[str, Any] = about["plan"]
        self._horizon: int = about["horizon"]
        self.cost_scale: float = about["cost_scale"]
        """By what the cost that it solves for is larger than that of the spec."""
        self._library = library
        self._state = np.zeros(1, struct_type(about["struct"]))
        self._in = np.zeros(1, struct_type(about["in"]))
        self._out = np.zeros(1, struct_type(about["out"]))
        self.init()

    @classmethod
    def of_folder(cls, folder: Path, library: Path) -> ControllerLibrary:
        """A controller of what `write_controller` wrote and `build_library` compiled."""
        (file,) = folder.glob("*_mpc.json")
        return cls(json.loads(file.read_text(encoding="utf-8")), ctypes.CDLL(str(library)))

    @property
    def real(self) -> np.dtype[np.floating[Any]]:
        """The type of its numbers."""
        return self._in.dtype["x"].base

    def init(self) -> None:
        """Begins a controller that knows nothing."""
        self._call("init", self._state)

    def reset(self, control: ArrayLike) -> None:
        """The same, with the controls that are applied now."""
        self._call("reset", self._state, np.ascontiguousarray(control, self._in.dtype["x"].base))

    def solve(self, values: Mapping[str, ArrayLike]) -> Decision:
        """Decides; `values` by field are `x` and what is known of the horizon."""
        return self._decided("solve", values)

    def prepare(self) -> None:
        """Does what needs no measurement."""
        self._call("prepare", self._state)

    def feedback(self, values: Mapping[str, ArrayLike]) -> Decision:
        """Decides by what was prepared."""
        return self._decided("feedback", values)

    def selftest(self) -> int:
        """Bits of the self-test; 0 if all is well."""
        return self._call("selftest")

    def member(self, name: str) -> Array:
        """A member of the struct, as it is now."""
        return self._state[0][name].copy()

    def plan(self) -> Array:
        """(x, u) of all stages, (N+1, nx+nu); there is no control at the end."""
        at = np.asarray(self._plan["places"])
        stages = self._plan["step"] * np.arange(self._horizon + 1)
        # the plan lies where the structure of the solver has it; places and step say where
        return self._state[0]["z"].ravel()[stages[:, None] + at]

    def _decided(self, function: str, values: Mapping[str, ArrayLike]) -> Decision:
        for name, value in values.items():
            self._in[0][name] = np.asarray(value).reshape(self._in.dtype[name].shape)
        status = self._call(function, self._state, self._in, self._out)
        found = self._out[0]
        return Decision(
            status, found["u"].copy(), float(found["residual"]), int(found["iterations"])
        )

    def _call(self, name: str, *arrays: Array) -> int:
        function = getattr(self._library, f"{self._prefix}_{name}")
        function.restype = ctypes.c_int
        return int(function(*(ctypes.c_void_p(array.ctypes.data) for array in arrays)))


def struct_type(members: list[dict[str, Any]]) -> np.dtype[Any]:
    """As C compilers place the members."""
    fields = [(m["name"], np.dtype(m["type"]), tuple(m["shape"])) for m in members]
    # as compilers do: each member at a multiple of its own size
    return np.dtype(fields, align=True)
