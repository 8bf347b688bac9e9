"""Scales the cost for a solver, whose tolerance and barriers are numbers without unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Constant
from compiler.ir.types import Axis, Type
from msnn.features.control.problem.optimal_control import ControlLimits, ControlProblem
from msnn.features.control.problem.structure import Chosen, chosen_structure

States = Mapping[str, NDArray[np.float64]]
"""By name (draws, *shape)."""
USUAL: Mapping[Chosen, float] = {"staged": 144.0, "condensed": 9.0}
"""The size of a cost that needs no scaling: of the two problems of `benchmarks/mpc` on which
the constants of each structure were chosen."""
_DRAWS = 64
_TRIES = 3
_STEPS = 16
_FAR = 10.0
"""Limit of a drawn simulation, in scales of the states or in multiples of its initial state."""
_ROUNDING = 1e-12
"""Of a sum of three costs; a smaller difference of them says nothing."""
_ONE_NUMBER = 1e-6
"""Of a number; values that are closer to each other are no range."""


def cost_scale(problem: ControlProblem) -> float:
    """σ, the factor by which a solver multiplies the cost J, so that its size is usual; 1 if the
    size is unknown.

    The size is the change of J as the first controls move over their ranges while all others stay:
    the largest difference of three tries, and of that the median over starts and later controls
    drawn from the declared ranges. A gradient of σJ of 1e-6 by a control, over its scale, is then
    an error of the control of about 1e-8 to 1e-7 of its range. Sizes are rounded, so that σ is 1
    for costs that are about as usual. If a simulation diverges, its states are set back to the
    start: a plan never costs as much. A reference without a range is as far from the plant as the
    ranges of the states allow (`compared`).
    """
    program = problem.program
    # the same points each time: an exported controller must not depend on chance
    random = np.random.default_rng(0)
    # rows beyond the last point, for windows that look ahead of it
    rows = _DRAWS + problem.longest_preview
    later = {s.name: drawn(random, rows, s.axes, s.range or (-1.0, 1.0)) for s in program.signals}
    for member, limits in zip(problem.controls.members, problem.control_limits, strict=True):
        later[member.name] = drawn(random, rows, member.axes, _range(problem, limits))
    starts = {
        state.name: drawn(
            random, _DRAWS, state.axes, state.range or _around_0(problem.state_scales[state.name])
        )
        for state in program.states
    }
    later = compared(problem, later, starts, _DRAWS)
    far = {
        name: _FAR * np.maximum(problem.state_scales[name], np.abs(values))
        for name, values in starts.items()
    }
    interpreter, at = Interpreter(program), np.arange(_DRAWS)
    costs: list[NDArray[np.float64]] = []
    for _ in range(_TRIES):
        first = {
            name: random.permutation(values) if name in _names(problem) else values
            for name, values in later.items()
        }
        total = np.zeros(_DRAWS)
        states: States = starts
        with np.errstate(all="ignore"):
            for k in range(problem.horizon):
                found = interpreter.step(later if k else first, at, states, losses=False)
                total = total + found.outputs[problem.stage]
                states = _near(found.next_states, starts, far)
            if problem.terminal is not None:
                found = interpreter.step(later, at, states, losses=False)
                total = total + found.outputs[problem.terminal]
        costs.append(total)
    with np.errstate(all="ignore"):
        changes = _spread(costs)
    if not changes.size:
        return 1.0
    usual = USUAL[chosen_structure(problem)]
    part, exponent = math.frexp(float(np.median(changes)))
    # so many steps from a power of two to the next: enough that no unit matters
    return usual / math.ldexp(round(_STEPS * 2 * part) / _STEPS, exponent - 1)


def with_scaled_cost(problem: ControlProblem) -> ControlProblem:
    """The problem with the cost σJ, which solvers get; its multipliers and costs are σ times as
    large.

    The solver chooses the weights of hard bounds, which are not scaled.
    """
    scale = problem.cost_scale
    if scale == 1:
        return problem
    builder = GraphBuilder(problem.program.step)
    factor = builder.constant(scale)
    costs = (problem.stage, problem.terminal)
    outputs = tuple(
        replace(output, node=builder.multiply(factor, output.node))
        if output.name in costs
        else output
        for output in problem.program.outputs
    )
    paths = tuple(
        replace(
            path,
            linear=None if path.linear is None else path.linear * scale,
            quadratic=None if path.quadratic is None else path.quadratic * scale,
        )
        for path in problem.path_limits
    )
    program = replace(problem.program, step=builder.graph(), outputs=outputs)
    return replace(problem, program=program, path_limits=paths, cost_scale=1.0)


def compared(
    problem: ControlProblem, log: Mapping[str, NDArray[np.float64]], states: States, draws: int
) -> Mapping[str, NDArray[np.float64]]:
    """The log, in which signals without a range are limited to the values with which the cost
    compares them.

    Set-points between -1 and 1 of a state of ±2e-6 would change the cost some 1e5 times as much as
    any plan does. A quadratic cost has its minimum over r where r equals the compared value: at the
    vertex of the parabola through three values of r. The middle 80 % of the vertices of all draws
    are the range. If there is no parabola, as for weights, or if all vertices are equal, the signal
    stays as it is. Shapes: (rows, *shape) of the log, (draws, *shape) of the states.
    """
    kept = {name: values.copy() for name, values in log.items()}
    interpreter, at = Interpreter(problem.program), np.arange(draws)
    outputs = [name for name in (problem.stage, problem.terminal) if name is not None]
    read = problem.reads(*map(problem.node, outputs)).signals - _names(problem)
    free = [s for s in problem.program.signals if s.range is None and s.name in read]

    def costs(values: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
        found = interpreter.step(values, at, states, losses=False)
        return np.sum([found.outputs[name] for name in outputs], axis=0)

    # first beside others at 0: of x + d - r with two of them, neither else shows the size of x
    for others in (0.0, 1.0):
        for signal in free:
            for place in np.ndindex(*Type(signal.axes).shape):
                around = {s.name: others * kept[s.name] for s in free}
                element = (slice(None), *place)
                parabola: list[NDArray[np.float64]] = []
                for value in (-1.0, 0.0, 1.0):
                    around[signal.name][element] = value
                    with np.errstate(all="ignore"):
                        parabola.append(costs({**kept, **around}))
                limits = _middle_of_vertices(*parabola)
                if limits is not None:
                    kept[signal.name][element] = np.clip(kept[signal.name][element], *limits)
    return kept


def drawn(
    random: np.random.Generator, rows: int, axes: tuple[Axis, ...], limits: tuple[float, float]
) -> NDArray[np.float64]:
    """Uniform random samples of a quantity between limits, (rows, *shape)."""
    return random.uniform(*limits, (rows, *Type(axes).shape))


def _middle_of_vertices(
    before: NDArray[np.float64], at_0: NDArray[np.float64], after: NDArray[np.float64]
) -> tuple[float, float] | None:
    """The 10 % and 90 % quantiles of the vertices of the parabolas through (-1, before), (0, at_0)
    and (1, after), one per draw. None if fewer than half of the draws have a parabola, or all
    vertices are equal.
    """
    with np.errstate(all="ignore"):
        slope, curvature = after - before, before - 2 * at_0 + after
        least = _ROUNDING * (np.abs(before) + np.abs(at_0) + np.abs(after))
        shown = (np.abs(slope) > least) & (np.abs(curvature) > least)
        vertices = -slope[shown] / (2 * curvature[shown])
    vertices = vertices[np.isfinite(vertices)]
    if 2 * vertices.size < before.size:
        return None
    low, high = (float(end) for end in np.quantile(vertices, (0.1, 0.9)))
    return (low, high) if high - low > _ONE_NUMBER * max(abs(low), abs(high)) else None


def _spread(costs: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """The largest minus the smallest cost of each draw; draws whose costs are equal or not finite
    are left out.
    """
    spread: NDArray[np.float64] = np.max(costs, axis=0) - np.min(costs, axis=0)
    return spread[np.isfinite(spread) & (spread > 0)]


def _near(states: States, starts: States, far: States) -> States:
    """The states, by name (draws, *shape). Draws with a state beyond `far` get their initial states
    again.
    """
    is_near = np.ones(_DRAWS, np.bool_)
    for name, values in states.items():
        is_near &= np.all((np.abs(values) <= far[name]).reshape(_DRAWS, -1), axis=1)
    return {
        name: np.where(is_near.reshape(-1, *(1,) * (values.ndim - 1)), values, starts[name])
        for name, values in states.items()
    }


def _names(problem: ControlProblem) -> set[str]:
    return {member.name for member in problem.controls.members}


def _around_0(scale: float) -> tuple[float, float]:
    return -scale, scale


def _range(problem: ControlProblem, control: ControlLimits) -> tuple[float, float]:
    """The range of a control: its constant limits, else the declared range, else its scale around
    0.
    """
    known = problem.program.signal(control.name).range
    low, high = known or _around_0(control.scale)
    ends = (_number(problem, end) for end in (control.limits.minimum, control.limits.maximum))
    least, most = ends
    if least is not None and most is not None:
        return least, most
    # one end alone: as far from it as the scale says
    if least is not None:
        return least, max(high, least + control.scale)
    if most is not None:
        return min(low, most - control.scale), most
    return low, high


def _number(problem: ControlProblem, output: str | None) -> float | None:
    op = None if output is None else problem.program.step[problem.node(output)].op
    return op.values[0] if isinstance(op, Constant) else None
