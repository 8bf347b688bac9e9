"""Says in numpy what `init` leaves, and which samples a step sees."""

from __future__ import annotations

from collections.abc import Mapping
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


def unset(
    interpreter: Interpreter,
    interface: Interface,
    states: dict[str, Array],
    log: tuple[dict[str, Array], int],
    step: int,
) -> dict[str, Array]:
    """States after `init`: the first step fills buffers with its newest sample.

    A buffer's sample may be computed from other buffers, so they are filled until none changes.
    """
    if step > 0:
        return states
    filled = dict(states)
    for _ in interface.filled_by_first:
        following = interpreter.step(*log, filled, losses=False).next_states
        for name in interface.filled_by_first:
            newest = following[name][..., -1:]
            filled[name] = np.broadcast_to(newest, filled[name].shape).copy()
    return filled


def log_of_step(interface: Interface, seen: Mapping[str, Array]) -> tuple[dict[str, Array], int]:
    """A log, and the row in it that sees exactly the samples of one step."""
    ports = {input.field.name: input.port for input in interface.inputs}
    row = max([0, *(-port.first for port in ports.values())])
    rows = row + 1 + max([0, *(port.last for port in ports.values())])
    log: dict[str, Array] = {}
    for name, port in ports.items():
        values = seen[name]
        samples = values[np.newaxis] if port.type.window is None else np.moveaxis(values, -1, 0)
        log[name] = np.zeros((rows, *samples.shape[1:]), values.dtype)
        log[name][row + port.first : row + port.last + 1] = samples
    return log, row
