"""Reads plan and multipliers of a controller's last solve, to check the KKT conditions."""

from __future__ import annotations

import numpy as np

from msnn.features.control.backend.library import ControllerLibrary
from msnn.features.control.backend.structure.rows import Rows
from msnn.features.control.problem.optimal_control.horizon import Multipliers, Plan, stages_of
from msnn.features.control.problem.optimal_control.problem import ControlProblem


def plan_of(problem: ControlProblem, library: ControllerLibrary) -> Plan:
    """Returns the states (N+1, nx) and controls (N, nu) of the last solve."""
    nx, n = problem.states.size, problem.horizon
    z = library.plan().astype(np.float64)
    return Plan(z[:, :nx], z[:n, nx:])


def multipliers_of(problem: ControlProblem, rows: Rows, library: ControllerLibrary) -> Multipliers:
    """Returns the multipliers of all limits at the last solve, for the cost of the spec."""
    n, nu = problem.horizon, problem.controls.size
    live = library.member("live") != 0
    # a control with no room between its limits is held by both
    live[:, : 2 * nu] |= np.repeat(library.member("room") == 0, 2, axis=1)
    sides = np.where(live, library.member("multiplier").astype(np.float64), 0.0)
    # the solver scales the cost, and the multipliers with it
    sides = sides / library.cost_scale
    # sides alternate: minimum, maximum
    low, high = sides[:, 0::2], sides[:, 1::2]
    rate_low, rate_high = np.zeros((n, nu)), np.zeros((n, nu))
    for number, rate in enumerate(rows.rates):
        rate_low[:, rate.control] = low[:n, nu + number]
        rate_high[:, rate.control] = high[:n, nu + number]
    first = nu + len(rows.rates)
    places: dict[str, slice] = {}
    for path in rows.paths:
        size = problem.type(path.value).size
        places[path.value] = slice(first, first + size)
        first += size
    paths = [(stages_of(problem, path), places[path.value]) for path in problem.path_limits]
    return Multipliers(
        control_min=low[:n, :nu],
        control_max=high[:n, :nu],
        rate_min=rate_low,
        rate_max=rate_high,
        path_min=tuple(low[stages, rows_] for stages, rows_ in paths),
        path_max=tuple(high[stages, rows_] for stages, rows_ in paths),
    )
