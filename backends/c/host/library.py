"""Calls a generated model from numpy, and reads and writes the memory of its structs."""

from __future__ import annotations

import ctypes
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spec_schema.registry import ARITHMETICS


class CStep:
    """One instance of a compiled model. `layout` is the entry `c` of the folder's JSON file.
    `weights` (physical values by name) replace the trained ones; they are ignored if the code has
    them inlined. Methods take values by name in the spec, in the shape of the port, and raise
    ValueError for missing or unknown names and wrong shapes.
    """

    def __init__(
        self,
        layout: Mapping[str, Any],
        library: ctypes.CDLL,
        weights: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        self._prefix: str = layout["prefix"]
        # a float model has reals; a fixed-point model has words and sums
        types = NUMBERS[layout["dtype"]]
        self.dtype = np.dtype(types.get("real", types.get("word")))
        """Type of inputs and outputs; integers in fixed point."""
        self.status_bits: dict[str, int] = layout["status"]
        """Bits of step and self-test, by the names of their macros."""
        self._structs = {
            name: StructMemory(fields, types) for name, fields in layout["structs"].items()
        }
        self._states = StateStruct(layout)
        self._library = library
        self._state = self._states.struct.new(1)
        self._parameters: Array | None = None
        if layout["takes_parameters"]:
            self._parameters = self._own_parameters(weights)

    @classmethod
    def of_folder(cls, folder: Path, library: Path) -> CStep:
        """An instance of a model that `write_c` wrote to `folder` and `build_library` compiled to
        `library`. Raises ValueError unless the folder has exactly one JSON file, OSError for an
        unreadable library.
        """
        return cls(_layout(folder), ctypes.CDLL(str(library)))

    @property
    def start_shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the arguments of `reset`, by name."""
        return self._structs["init"].shapes

    @property
    def input_shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the arguments of `step`, by name."""
        return self._structs["in"].shapes

    def init(self) -> None:
        """Sets the states that need no recorded samples; the others stay marked as unset."""
        self._function("init")(*self.instance)

    def reset(self, windows: Mapping[str, ArrayLike]) -> int:
        """Sets all states from samples around the first step; returns status bits. `windows` are
        the arguments of `reset` by name, with the shapes of `start_shapes`.
        """
        start = self._structs["init"].filled(windows, 1)
        reset = self._function("reset", ctypes.c_uint32)
        return int(reset(*self.instance, start.ctypes.data))

    def step(self, inputs: Mapping[str, ArrayLike]) -> tuple[dict[str, Array], int]:
        """Runs one step with these inputs; returns the outputs by name and the status bits."""
        series = {name: np.asarray(value)[np.newaxis] for name, value in inputs.items()}
        outputs, status = self.run(series, 1)
        return {name: values[0] for name, values in outputs.items()}, int(status[0])

    def run(
        self, inputs: Mapping[str, ArrayLike], steps: int
    ) -> tuple[dict[str, Array], NDArray[np.uint32]]:
        """Runs `steps` steps with inputs (steps, *shape) by name; returns outputs (steps, *shape)
        by name and the status bits of each step (steps,).
        """
        given = self._structs["in"].filled(inputs, steps)
        outputs = self._structs["out"].new(steps)
        status = np.zeros(steps, np.uint32)
        instance = self.instance
        if hasattr(self._library, f"{self._prefix}_run"):  # built with the loop of the FFI
            # one call for all steps: a ctypes call is slower than a step
            addresses = (given.ctypes.data, outputs.ctypes.data, status.ctypes.data)
            self._function("run")(*instance, *addresses, steps)
            return self._structs["out"].values(outputs), status
        step = self._function("step", ctypes.c_uint32)
        for k in range(steps):
            to = given.ctypes.data + k * given.itemsize
            status[k] = step(*instance, to, outputs.ctypes.data + k * outputs.itemsize)
        return self._structs["out"].values(outputs), status

    def linearize(self, inputs: Mapping[str, ArrayLike]) -> tuple[dict[str, Array], int]:
        """The Jacobian of the next step with these inputs: its matrices (rows, columns) by name,
        and status bits. The state does not change.
        """
        given = self._structs["in"].filled(inputs, 1)
        slopes = self._structs["jacobian"].new(1)
        call = self._function("linearize", ctypes.c_uint32)
        status = call(*self.instance, given.ctypes.data, slopes.ctypes.data)
        values = self._structs["jacobian"].values(slopes)
        return {name: value[0] for name, value in values.items()}, int(status)

    def get_state(self, numbers: int) -> Array:
        """The state as vector x of the Jacobian. `numbers` is the length of x."""
        x = np.zeros(numbers, self.dtype)
        self._function("get_state")(self._state.ctypes.data, x.ctypes.data)
        return x

    def set_state(self, x: ArrayLike) -> None:
        """Sets the states that the vector x of the Jacobian contains; its order is that of
        `get_state`.
        """
        values = np.ascontiguousarray(x, self.dtype)
        self._function("set_state")(self._state.ctypes.data, values.ctypes.data)

    def tune(self, parameters: Mapping[str, ArrayLike]) -> None:
        """Changes some parameters (physical values by name) of this instance only. Raises
        ValueError if they are inlined in the code.
        """
        if self._parameters is None:
            raise ValueError("the parameters of this code are written into it")
        struct = self._structs["params"]
        current = {name: values[0] for name, values in struct.values(self._parameters).items()}
        self._parameters = struct.filled(current | dict(parameters), 1)

    def states(self) -> dict[str, Array]:
        """The current states by name, in the shapes of the spec, buffers with the oldest sample
        first. Empty for fixed-point code.
        """
        return self._states.values(self._state[0])

    def set_states(self, values: Mapping[str, ArrayLike]) -> None:
        """Sets all states (by name, in the shapes of `states`) of an instance after `init` or
        `reset`. Raises KeyError if one is missing.
        """
        self._states.fill(self._state[0], values)

    def word(self, field: str) -> int:
        """The value of an integer field of the state struct that the spec does not name, such as
        `ready`. Raises ValueError for an unknown field.
        """
        return int(self._state[0][field])

    def set_word(self, field: str, value: int) -> None:
        """Writes an integer field of the state struct that the spec does not name, such as `ready`.
        Raises ValueError for an unknown field.
        """
        self._state[0][field] = value

    def selftest(self) -> int:
        """Runs the self-test; returns the bits of its failed checks (`SelfTestBit`), 0 for
        success.
        """
        return int(self._function("selftest", ctypes.c_uint32)())

    def _own_parameters(self, weights: Mapping[str, ArrayLike] | None) -> Array:
        struct = self._structs["params"]
        if weights is not None:
            return struct.filled({name: weights[name] for name in struct.shapes}, 1)
        first = ctypes.c_char.in_dll(self._library, f"{self._prefix}_params_default")
        # a copy: all instances share the read-only constant of the library; the size is needed
        # since the bytes contain zeros
        text = ctypes.string_at(ctypes.addressof(first), struct.dtype.itemsize)
        return np.frombuffer(text, struct.dtype)

    @property
    def instance(self) -> tuple[int, ...]:
        """The addresses of state and parameters (if the code takes them), the first arguments of
        every function.
        """
        state = self._state.ctypes.data
        return (state,) if self._parameters is None else (state, self._parameters.ctypes.data)

    def _function(self, name: str, result: Any = None) -> Any:
        function = getattr(self._library, f"{self._prefix}_{name}")
        function.restype = result

        # as void pointers: ctypes passes a plain integer as a C int without its upper half
        def call(*addresses: int) -> Any:
            return function(*map(ctypes.c_void_p, addresses))

        return call


def _layout(folder: Path) -> dict[str, Any]:
    """The entry `c` of the folder's JSON file: number types, structs and status bits. Raises
    ValueError unless the folder has exactly one JSON file.
    """
    files = sorted(folder.glob("*.json"))
    if len(files) != 1:
        raise ValueError(f"{folder} holds {len(files)} JSON files, not the one about its C")
    return json.loads(files[0].read_text(encoding="utf-8"))["c"]


Array = NDArray[Any]


class StructMemory:
    """The layout of a C struct as a numpy dtype, with the padding of C compilers. `fields` are from
    the JSON file; `types` maps its number types (`real`, `word`) to numpy names.
    """

    def __init__(self, fields: list[dict[str, Any]], types: Mapping[str, str]) -> None:
        kinds = {**types, "uint32": "uint32"}
        members = [(f["field"], np.dtype(kinds[f["type"]]), tuple(f["shape"])) for f in fields]
        # the order of the JSON file is the order of the header's fields
        self.dtype = np.dtype(members, align=True)
        self._fields = {f["name"]: f for f in fields if f["name"] is not None}

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shapes of the fields that the spec names, by name in the spec."""
        return {name: tuple(field["shape"]) for name, field in self._fields.items()}

    def new(self, count: int) -> Array:
        return np.zeros(count, self.dtype)

    def filled(self, values: Mapping[str, ArrayLike], count: int) -> Array:
        """An array of `count` structs with these values by name, each (count, *shape), or (*shape)
        if count is 1. Raises ValueError for missing or unknown names and wrong shapes.
        """
        if values.keys() != self._fields.keys():
            expected, given = sorted(self._fields), sorted(values)
            raise ValueError(f"values wanted for {expected}, given for {given}")
        structs = self.new(count)
        for name, value in values.items():
            target = structs[self._fields[name]["field"]]
            # a series has an additional axis: (count, *shape)
            array = np.asarray(value)
            shape = target.shape if array.ndim == target.ndim else target.shape[1:]
            if array.shape != shape or (shape != target.shape and count != 1):
                raise ValueError(f"`{name}` has shape {array.shape}, not {target.shape}")
            target[...] = array
        return structs

    def values(self, structs: Array) -> dict[str, Array]:
        """Copies of the fields that the spec names, (count, *shape) by name, from an array of
        structs.
        """
        return {name: structs[field["field"]].copy() for name, field in self._fields.items()}


NUMBERS: dict[str, dict[str, str]] = {
    "float32": {"real": "float32"},
    "float64": {"real": "float64"},
    **{
        name: {"word": f"int{each.word_bits}", "sum": f"int{each.sum_bits}"}
        for name, each in ARITHMETICS.items()
    },
}
"""Types of fields, by the number format of a program."""


class StateStruct:
    """The state struct of a model, with access to the states in it by name. `layout` is the entry
    `c` of the folder's JSON file.
    """

    def __init__(self, layout: Mapping[str, Any]) -> None:
        self.struct = StructMemory(layout["structs"]["state"], NUMBERS[layout["dtype"]])
        self._states: list[dict[str, Any]] = layout.get("states", [])

    def values(self, memory: Any) -> dict[str, Array]:
        """The states by name from one struct in `memory`, in the shapes of the spec, buffers with
        the oldest sample first. Empty in fixed point.
        """
        return {state["name"]: _value_of(state, memory) for state in self._states}

    def fill(self, memory: Any, values: Mapping[str, ArrayLike]) -> None:
        """Writes all states into one struct in `memory`. `values` have the shapes of
        `StateStruct.values`; raises KeyError if one is missing.
        """
        for state in self._states:
            field = memory[state["field"]]
            _set_value(state, memory, np.asarray(values[state["name"]], field.dtype))


def _value_of(state: dict[str, Any], memory: Any) -> Array:
    """The value of a state from one struct, in the shape of the spec. `state` describes its storage
    (kind `plain`, `shift` or `ring`); buffers reserve more room than their samples need.
    """
    stored, shape = memory[state["field"]], tuple(state["shape"])
    if state["kind"] == "plain":
        return stored.reshape(shape).copy()
    *rows, kept = shape
    samples = stored.reshape(*rows, -1)
    begin = 0
    if state["kind"] == "ring":
        begin = int(memory[state["head"]]) % (samples.shape[-1] // 2) + 1
    return samples[..., begin : begin + kept].copy()


def _set_value(state: dict[str, Any], memory: Any, value: Array) -> None:
    """Writes the value of a state into one struct. `state` describes its storage (kind `plain`,
    `shift` or `ring`); a ring stores every sample twice and has its write position reset to 0.
    """
    if state["kind"] == "plain":
        memory[state["field"]] = value.reshape(memory[state["field"]].shape)
        return
    *rows, kept = state["shape"]
    stored = memory[state["field"]].reshape(*rows, -1)
    if state["kind"] == "shift":
        stored[..., :kept] = value
        return
    # the oldest sample of a ring is one after its head, so it begins at index 1
    memory[state["head"]] = 0
    stored[..., 1 : kept + 1] = value
    stored[..., kept + 2 :] = value
