"""Reports implausible controllers: too exact, too large, or with a cost of the wrong sign."""

from __future__ import annotations

from msnn.features.control.elaborate.mpc.concave import concave_in
from msnn.features.control.errors import control as errors
from msnn.features.control.keys.mpc import InteriorPoint, OptimalControl
from msnn.features.control.problem.optimal_control.problem import ControlProblem
from msnn.features.control.problem.optimal_control.structure import (
    chosen_structure,
    estimate,
    numbers_of,
)
from spec_schema.diagnostics.diagnostic import Findings

LEAST_TOLERANCE = 1e-11
"""Rounding of a scaled residual in double precision leaves some 1e-13."""
LONG, TOO_LONG = 2**24, 2**28
"""Bytes of a controller in double precision that are reported, and that are refused."""


def check_plausible(problem: ControlProblem, section: OptimalControl, findings: Findings) -> None:
    """Reports errors and warnings about implausible settings."""
    if section.interior_point is not None:
        check_tolerance(section.interior_point, findings)
    _check_size(problem, section, findings)
    if not findings.failed:
        _check_signs(problem, section, findings)


def check_tolerance(solver: InteriorPoint, findings: Findings) -> None:
    """Reports a tolerance below rounding."""
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
