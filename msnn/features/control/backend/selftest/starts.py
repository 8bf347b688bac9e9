"""Draws initial states for the self-test of a controller."""

from __future__ import annotations

import numpy as np

from compiler.ir.types import Type
from msnn.features.control.problem.optimal_control.problem import ControlProblem

STARTS = 6


def drawn_starts(problem: ControlProblem, count: int = STARTS) -> list[list[float]]:
    """Draws `count` states x, each within its range or ± its scale.

    The first one is 0, or the value of the range nearest to 0.
    """
    random = np.random.default_rng(0)
    rows: list[list[float]] = []
    for number in range(count):
        row: list[float] = []
        for state in problem.program.states:
            size, scale = Type(state.axes).size, problem.state_scales[state.name]
            low, high = state.range or (-scale, scale)
            drawn = random.uniform(low, high, size)
            nearest = np.clip(np.zeros(size), low, high)
            row += [float(x) for x in (nearest if number == 0 else drawn)]
        rows.append(row)
    return rows
