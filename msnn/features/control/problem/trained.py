"""Puts trained weights into optimal control problems and estimation windows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from compiler.interpreter.interpreter import Interpreter
from compiler.passes.inline_parameters import inline_parameters
from msnn.features.control.problem.cost_scale import compared, cost_scale, drawn
from msnn.features.control.problem.optimal_control import ControlProblem, PathLimits
from msnn.features.control.problem.window_problem import WindowProblem

DRAWS = 256
_STEEPER = 10.0
"""Ratio of a penalty to the largest mean gradient of the cost at the drawn points."""


def trained(problem: ControlProblem, weights: Mapping[str, ArrayLike]) -> ControlProblem:
    """The problem with its parameters replaced by weights, and with weights of all soft bounds. A
    parameter without a weight has its initial value.

    A bound without a weight in the spec has w₁ = 10 · N · c / s and w₂ = w₁ / s. Here s is the
    scale of the bounded value, N the horizon, and c the largest stage cost at points drawn from the
    declared ranges. The cost of a whole horizon changes by about N · c over a distance s, and an
    exact penalty must be steeper.
    """
    known = replace(problem, program=inline_parameters(problem.program, weights))
    # where every weight is said, nobody needs the size of the cost
    if all(path.hard or path.linear is not None for path in problem.path_limits):
        steepest = 0.0
    else:
        steepest = _STEEPER * problem.horizon * size_of_cost(known)
    paths: list[PathLimits] = []
    for path in problem.path_limits:
        if path.hard:
            paths.append(path)
            continue
        linear = steepest / path.scale if path.linear is None else path.linear
        quadratic = linear / path.scale if path.quadratic is None else path.quadratic
        paths.append(replace(path, linear=linear, quadratic=quadratic))
    return replace(known, path_limits=tuple(paths), cost_scale=cost_scale(known))


def size_of_cost(problem: ControlProblem) -> float:
    """The largest magnitude of the stage cost at points drawn from the declared ranges; 1 if none
    is finite and nonzero.
    """
    program = problem.program
    # the same points each time: an exported controller must not depend on chance
    random = np.random.default_rng(0)
    limits = {control.name: control.scale for control in problem.control_limits}
    # rows beyond the last point, for windows that look ahead of it
    rows = DRAWS + problem.longest_preview

    def around_0(scale: float) -> tuple[float, float]:
        return -scale, scale

    log = {
        signal.name: drawn(
            random, rows, signal.axes, signal.range or around_0(limits.get(signal.name, 1.0))
        )
        for signal in program.signals
    }
    states = {
        state.name: drawn(
            random, DRAWS, state.axes, state.range or around_0(problem.state_scales[state.name])
        )
        for state in program.states
    }
    log = compared(problem, log, states, DRAWS)
    found = Interpreter(program).step(log, np.arange(DRAWS), states, losses=False)
    costs = np.abs(found.outputs[problem.stage])
    # costs that are 0 everywhere say nothing of how steep they are
    finite = costs[np.isfinite(costs) & (costs > 0)]
    return float(finite.max()) if finite.size else 1.0


_FAR_OFF = 10.0
"""Standard deviations by which all measurements may contradict a range before it is violated."""


def trained_window(window: WindowProblem, weights: Mapping[str, ArrayLike]) -> ControlProblem:
    """The problem of an estimation window with its parameters replaced by weights; other `weights`
    are ignored.

    Over the scale s of a bounded state, errors change by about √c standard deviations, with c the
    largest cost of a sample at points drawn from the declared ranges. If each of N+1 samples is off
    by r deviations, the cost has a gradient of 2 r (N+1) √c / s: this is w₁, the linear cost of
    leaving a range. Such a cost is in standard deviations already, and is not scaled.
    """
    control = window.control
    own = {parameter.name for parameter in control.program.parameters}
    # weights of other parameters than the window reads would be refused as unknown
    given = {name: value for name, value in weights.items() if name in own}
    known = replace(control, program=inline_parameters(control.program, given))
    # of all N+1 samples at once: the horizon of the problem has one stage more than the window
    steep = 2 * _FAR_OFF * control.horizon * size_of_cost(known) ** 0.5
    paths = tuple(
        path if path.hard else replace(path, linear=steep / path.scale)
        for path in control.path_limits
    )
    return replace(trained(replace(control, path_limits=paths), given), cost_scale=1.0)
