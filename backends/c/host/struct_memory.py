"""Reads and writes the memory of the structs of generated C."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spec_schema.registry import ARITHMETICS

Array = NDArray[Any]


class StructMemory:
    """A struct of the header as a numpy type; `align` pads fields like C compilers."""

    def __init__(self, fields: list[dict[str, Any]], types: Mapping[str, str]) -> None:
        kinds = {**types, "uint32": "uint32"}
        members = [(f["field"], np.dtype(kinds[f["type"]]), tuple(f["shape"])) for f in fields]
        # the order of the JSON file is the order of the header's fields
        self.dtype = np.dtype(members, align=True)
        self._fields = {f["name"]: f for f in fields if f["name"] is not None}

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shapes of the fields that the spec names."""
        return {name: tuple(field["shape"]) for name, field in self._fields.items()}

    def new(self, count: int) -> Array:
        return np.zeros(count, self.dtype)

    def filled(self, values: Mapping[str, ArrayLike], count: int) -> Array:
        """Structs with the values; for a single struct the axis of the series may be missing."""
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
        """The fields that the spec names, (count, *shape)."""
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
    """The state struct of a model, with the places of its states.

    `layout` is the description of the C code in the folder's JSON file.
    """

    def __init__(self, layout: Mapping[str, Any]) -> None:
        self.struct = StructMemory(layout["structs"]["state"], NUMBERS[layout["dtype"]])
        self._states: list[dict[str, Any]] = layout.get("states", [])

    def values(self, memory: Any) -> dict[str, Array]:
        """The values of all states, buffers with the oldest sample first; empty in fixed point."""
        return {state["name"]: _value_of(state, memory) for state in self._states}

    def fill(self, memory: Any, values: Mapping[str, ArrayLike]) -> None:
        """Sets all states, in the shapes of `values`."""
        for state in self._states:
            field = memory[state["field"]]
            _set_value(state, memory, np.asarray(values[state["name"]], field.dtype))


def _value_of(state: dict[str, Any], memory: Any) -> Array:
    """The value of a state from the struct; a buffer has room for one additional sample."""
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
    """Writes the value of a state to the struct; a ring stores every sample twice."""
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
