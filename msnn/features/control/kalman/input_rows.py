"""Checks the inputs of a filter for one sample, and arranges them as rows of a log."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiler.ir.types import Type
from msnn.features.control.problem.state_estimation.problem import EstimationProblem


def input_rows(
    problem: EstimationProblem, inputs: Mapping[str, ArrayLike], wanted: Collection[str]
) -> dict[str, NDArray[Any]]:
    """One row of each port, zeros for those that are not wanted and not given.

    Raises ValueError for an input that is missing, unknown or of another shape.
    """
    names = [member.name for member in problem.inputs.members]
    unknown = sorted({*inputs} - {*names})
    if unknown or not {*wanted} <= {*inputs}:
        message = f"inputs wanted for {sorted(wanted)}, given for {sorted(inputs)}"
        raise ValueError(message)
    log: dict[str, NDArray[Any]] = {}
    for member in problem.inputs.members:
        type = Type(member.axes)
        shape = type.shape
        array = np.asarray(inputs.get(member.name, np.zeros(shape)), float)
        if array.shape != shape:
            raise ValueError(f"`{member.name}` has shape {array.shape}, not {shape}")
        # the samples of a window are the rows of the log: a port's last axis goes first
        log[member.name] = array[None] if type.window is None else np.moveaxis(array, -1, 0)
    return log
