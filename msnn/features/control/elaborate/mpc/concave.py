"""Finds states and controls in which a cost is concave: usually a weight with a wrong sign.

A cost of one number v, with all others held, is concave where its second difference is negative:
l(v − s) + l(v + s) − 2 l(v) < 0. What it is at every point tried is what the formula means.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.types import Type
from compiler.passes.simplify import drop_unused
from msnn.features.control.problem.optimal_control.problem import ControlProblem

_DRAWS = 16
_LEAST = 1e-9
"""A second difference below this part of its terms is rounding."""

Array = NDArray[np.float64]


def concave_in(problem: ControlProblem, cost: str) -> Iterator[str]:
    """The states and controls, by name, in which a cost is concave at all points that are drawn.

    Nothing where the cost depends on parameters: training decides then.
    """
    program = drop_unused(replace(problem.program, outputs=(problem.program.output(cost),)))
    if program.parameters:
        return
    reads = problem.reads(problem.node(cost))
    # the same points in every check: a warning must not come and go
    random = np.random.default_rng(0)
    scales = {c.name: c.scale for c in problem.control_limits} | dict(problem.state_scales)
    interpreter = Interpreter(program)
    states = {
        state.name: scales[state.name] * random.uniform(-1, 1, (_DRAWS, *Type(state.axes).shape))
        for state in program.states
    }
    log = {
        signal.name: scales.get(signal.name, 1.0)
        # rows beyond the last point, for windows that look ahead of it
        * random.uniform(-1, 1, (_DRAWS + problem.longest_preview, *Type(signal.axes).shape))
        for signal in program.signals
    }

    def values(states: dict[str, Array], log: dict[str, Array]) -> Array:
        found = interpreter.step(log, np.arange(_DRAWS), states, losses=False)
        return np.asarray(found.outputs[cost], np.float64).reshape(_DRAWS)

    controls = [member.name for member in problem.controls.members]
    for name in [*sorted(reads.states), *(c for c in controls if c in reads.signals)]:
        known = states if name in reads.states else log
        ends: list[Array] = []
        for sign in (-1.0, 1.0):
            moved = known | {name: known[name] + sign * scales[name]}
            ends.append(values(moved, log) if known is states else values(states, moved))
        middle = values(states, log)
        bend = ends[0] + ends[1] - 2 * middle
        size = np.abs(ends[0]) + np.abs(ends[1]) + 2 * np.abs(middle)
        # everywhere that was tried: costs that saturate are concave in places and meant so
        if np.all(bend < -_LEAST * size):
            yield name
