"""Puts trained weights into the problem of a window, and sets the cost of violating a range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from numpy.typing import ArrayLike

from compiler.passes.inline_parameters import inline_parameters
from msnn.features.control.problem.moving_horizon.window_problem import WindowProblem
from msnn.features.control.problem.optimal_control.problem import ControlProblem
from msnn.features.control.problem.optimal_control.trained import size_of_cost, trained

_FAR_OFF = 10.0
"""Standard deviations by which all measurements may contradict a range before it is violated."""


def trained_window(window: WindowProblem, weights: Mapping[str, ArrayLike]) -> ControlProblem:
    """The problem without parameters; what is known of others than its own is left out.

    Over the scale s of a bounded state errors change by about √c deviations, c the largest cost of
    a sample at points drawn from what is declared. Where each of N+1 samples is r deviations off,
    the cost has a slope of 2 r (N+1) √c / s: w₁, the linear cost of leaving a range. Such a cost is
    in deviations already: a solver takes it as it is.
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
