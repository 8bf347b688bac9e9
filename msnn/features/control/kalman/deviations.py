"""Lists the standard deviations of ξ (states, then parameters), as the spec gives them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from compiler.ir.program import Tape
from compiler.ir.types import Type
from compiler.jacobian.matrices import Vector
from msnn.features.control.problem.state_estimation.problem import EstimationProblem


def deviations(
    problem: EstimationProblem, numbers: Vector, *, initial: bool
) -> NDArray[np.float64]:
    """The deviations of ξ, at first or in a second; 0 but for the newest of a register fed back."""
    found = np.zeros(numbers.size)
    table = {**problem.deviations, **problem.parameters}
    for member in numbers.members:
        if member.name in table:
            std = table[member.name].initial if initial else table[member.name].drift
            values = np.full(Type(member.axes).shape, std)
            if isinstance(problem.registers.get(member.name), Tape) and not initial:
                # what was fed back before was corrected before: noise is of the newest alone
                values[..., :-1] = 0.0
            found[member.first : member.first + member.size] = values.ravel()
    return found
