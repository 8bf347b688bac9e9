"""Computes in NumPy the states after `init` and those that the first step fills."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from compiler.interpreter.interpreter import Interpreter

Array = NDArray[Any]


def emptied(interface: Interface, states: Mapping[str, Array]) -> dict[str, Array]:
    """States after `init`; those that only recorded samples could initialise are 0."""
    return {
        name: np.zeros_like(value) if name in interface.from_record else value
        for name, value in states.items()
    }


def filled_by_first(
    interpreter: Interpreter,
    interface: Interface,
    states: Mapping[str, Array],
    log: tuple[dict[str, Array], NDArray[np.int64]],
    rows: Sequence[int],
) -> dict[str, Array]:
    """States after `init` in the given runs: the first step fills buffers with its newest sample.

    The newest sample of a buffer may depend on other buffers, so that filling is repeated once per
    buffer.
    """
    filled = {name: value.copy() for name, value in states.items()}
    # a chain of buffers that read each other is at most as long as their count
    for _ in interface.filled_by_first:
        following = interpreter.step(*log, filled, losses=False).next_states
        for name in interface.filled_by_first:
            newest = following[name][rows, ..., -1:]
            filled[name][rows] = np.broadcast_to(newest, filled[name][rows].shape)
    return filled
