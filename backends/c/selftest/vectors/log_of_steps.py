"""Arranges the inputs of steps as a log, which the interpreter reads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface

Array = NDArray[Any]


def log_of_steps(
    interface: Interface, inputs: Mapping[str, Array], count: int
) -> tuple[dict[str, Array], NDArray[np.int64]]:
    """A log, and for each of `count` steps the row at which it reads exactly its inputs.

    Inputs are (steps, *shape), with the samples of a preview along their last axis.
    """
    ports = {input.field.name: input.port for input in interface.inputs}
    row = max([0, *(-port.first for port in ports.values())])
    # each step has rows of its own, as policies may have changed what its neighbours saw
    rows = row + 1 + max([0, *(port.last for port in ports.values())])
    log: dict[str, Array] = {}
    for name, port in ports.items():
        values = inputs[name]
        samples = values[:, np.newaxis] if port.type.window is None else np.moveaxis(values, -1, 1)
        each = np.zeros((count, rows, *samples.shape[2:]), values.dtype)
        each[:, row + port.first : row + port.last + 1] = samples
        log[name] = each.reshape(count * rows, *samples.shape[2:])
    return log, row + rows * np.arange(count)
