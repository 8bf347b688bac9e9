"""Says in numpy what `init` leaves, and what the first step makes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from compiler.interpreter.interpreter import Interpreter

Array = NDArray[Any]


def emptied(interface: Interface, states: Mapping[str, Array]) -> dict[str, Array]:
    """States as `init` leaves them: what only a record can give is 0."""
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
    """States after `init` in some of the runs: the first step fills buffers with its newest sample.

    A buffer's sample may be computed from other buffers, so they are filled until none changes.
    """
    filled = {name: value.copy() for name, value in states.items()}
    # as many rounds as buffers: the longest chain of buffers that read each other
    for _ in interface.filled_by_first:
        following = interpreter.step(*log, filled, losses=False).next_states
        for name in interface.filled_by_first:
            newest = following[name][rows, ..., -1:]
            filled[name][rows] = np.broadcast_to(newest, filled[name][rows].shape)
    return filled
