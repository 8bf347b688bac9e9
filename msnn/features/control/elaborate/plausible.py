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
from msnn.features.control.errors import control as errors
from msnn.features.control.keys import InteriorPoint, OptimalControl
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.structure import chosen_structure, estimate, numbers_of
from spec_schema.diagnostics.diagnostic import Findings

_DRAWS = 16
_LEAST = 1e-9
"""A second difference below this part of its terms is rounding."""

Array = NDArray[np.float64]


def concave_in(problem: ControlProblem, cost: str) -> Iterator[str]:
    """Yields the names of states and controls in which a cost is concave at all sampled points;
    `cost` is the name of its output.

    Yields nothing if the cost depends on parameters, as training determines its shape.
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


LEAST_TOLERANCE = 1e-11
"""Rounding of a scaled residual in double precision leaves some 1e-13."""
LONG, TOO_LONG = 2**24, 2**28
"""Bytes of a controller in double precision that are reported, and that are refused."""


def check_plausible(problem: ControlProblem, section: OptimalControl, findings: Findings) -> None:
    """Reports a tolerance below rounding, a horizon that needs much memory, and costs with a wrong
    sign.
    """
    if section.interior_point is not None:
        check_tolerance(section.interior_point, findings)
    _check_size(problem, section, findings)
    if not findings.failed:
        _check_signs(problem, section, findings)


def check_tolerance(solver: InteriorPoint, findings: Findings) -> None:
    """Reports a tolerance of the solver below the rounding error of double precision."""
    if solver.tolerance is not None and solver.tolerance < LEAST_TOLERANCE:
        place = solver.place.key
        findings.report(errors.tolerance_of_rounding(solver.tolerance, LEAST_TOLERANCE, place))


def _check_size(problem: ControlProblem, section: OptimalControl, findings: Findings) -> None:
    chosen = chosen_structure(problem)
    found = estimate(problem)
    products = found.condensed if chosen == "condensed" else found.staged
    # in doubles, the wider format: single precision is an option of the export
    memory = numbers_of(problem, chosen) * 8
    if memory < LONG:
        return
    told = f"about {memory / 2**20:,.0f} MiB"
    make = errors.horizon_of_memory if memory > TOO_LONG else errors.horizon_is_long
    findings.report(make(problem.horizon, told, products, section.horizon.span))


def _check_signs(problem: ControlProblem, section: OptimalControl, findings: Findings) -> None:
    terms = [("cost.stage", problem.stage, section.cost.stage)]
    if problem.terminal is not None and section.cost.terminal is not None:
        terms.append(("cost.terminal", problem.terminal, section.cost.terminal))
    for key, output, formula in terms:
        for name in concave_in(problem, output):
            findings.report(errors.concave_cost(key, name, formula.span))
