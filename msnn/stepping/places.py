"""Locates the values of a step by name, and validates assigned values."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.c.interface.interface import Field, Interface
from compiler.ir.program import Signal

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class RealsPlace:
    """A value among the reals of a struct: one element at `index`, or the array `view`."""

    name: str
    index: int
    view: Array | None
    refuses: bool = False
    """True if non-finite values are refused, because no policy replaces them."""

    def number(self, value: Any) -> float:
        """The value as float. ValueError if it is not a finite number."""
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise ValueError(f"`{self.name}` is a number, not {value!r}") from None
        if self.refuses and not isfinite(number):
            raise ValueError(not_finite(self.name, number))
        return number

    def put(self, value: ArrayLike) -> None:
        """Writes an array. ValueError for another shape, or non-finite elements."""
        assert self.view is not None
        array = shaped(self.name, value, self.view.shape)
        if self.refuses and not np.isfinite(array).all():
            raise ValueError(not_finite(self.name, array[~np.isfinite(array)][0]))
        with np.errstate(over="ignore"):  # too large for float32: the step says so
            self.view[...] = array


def numbers_of(name: str, value: ArrayLike) -> Array:
    """The value as array. ValueError if it is not numeric."""
    try:
        return np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"`{name}` is not made of numbers: {value!r}") from None


def shaped(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """The value as array. ValueError for another shape."""
    array = numbers_of(name, value)
    if array.shape != shape:
        raise ValueError(f"`{name}` has shape {array.shape}, not {shape}")
    return array


def not_finite(name: str, value: float) -> str:
    """The message for a refused value, with the policies that would accept it."""
    return (
        f"`{name}` is {value}: `on_invalid: clamp` or `hold` of the input replaces such values, "
        "`trust` lets them pass"
    )


def not_a_start(name: str, value: float) -> str:
    """The message for an invalid initial state."""
    return f"`{name}` is {value}: no step brings a state back that is not finite; give a number"


def refuses(signal: Signal) -> bool:
    """True if the C code would report non-finite values but still use them."""
    # `clamp` and `hold` replace such a value in C; `trust` promises that there is none
    return signal.on_invalid == "flag"


def input_places(interface: Interface, memory: Any) -> dict[str, RealsPlace]:
    """The inputs of a step in its memory."""
    fields = [input.field for input in interface.inputs]
    checked = {input.field.name: refuses(input.port.signal) for input in interface.inputs}
    return {
        place.name: RealsPlace(place.name, place.index, place.view, checked[place.name])
        for place in _places(fields, memory, interface)
    }


def output_places(interface: Interface, memory: Any) -> tuple[RealsPlace, ...]:
    """The outputs of a step in its memory."""
    return tuple(_places(interface.outputs, memory, interface))


def _places(fields: Iterable[Field], memory: Any, interface: Interface) -> Iterable[RealsPlace]:
    # a view of the memory of ctypes: writing to it is writing the struct
    numbers = np.frombuffer(memory, interface.options.dtype)
    begin = 0
    for field in fields:
        view = numbers[begin : begin + field.size].reshape(field.shape) if field.shape else None
        yield RealsPlace(field.name, begin, view)
        begin += field.size
