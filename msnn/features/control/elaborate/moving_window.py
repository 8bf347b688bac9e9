"""Reads the length of the window of moving-horizon estimation, and its solver's settings."""

from __future__ import annotations

from compiler.ir.program import Program
from compiler.lowering.context import LoweringFailed, Sampling
from msnn.features.control.elaborate.control_problem import ITERATIONS, TOLERANCE
from msnn.features.control.elaborate.plausible import TOO_LONG, check_tolerance
from msnn.features.control.errors import estimation as errors
from msnn.features.control.keys import MovingHorizon
from msnn.features.control.problem.optimal_control import Mode
from msnn.features.control.problem.state_estimation import EstimationProblem, MovingWindow
from msnn.features.control.problem.structure import estimate, numbers_of
from msnn.features.control.problem.window_problem import window_problem
from spec_schema.diagnostics.diagnostic import Findings


def moving_window(
    section: MovingHorizon, program: Program, findings: Findings
) -> MovingWindow | None:
    """The window of an `mhe` section, with the settings of its solver. Mistakes are reported; None
    if the length is no multiple of the sample time.
    """
    _check_something_moves(section, findings)
    solver = None if section.solver is None else section.solver.interior_point
    mode: Mode = "converged" if solver is None else solver.mode
    iterations, tolerance = ITERATIONS[mode], TOLERANCE
    if solver is not None:
        check_tolerance(solver, findings)
        # what condensing eliminates, the states, is what an estimator is asked for
        if solver.structure == "condensed":
            findings.report(errors.condensed_window(solver.place.key))
        iterations = solver.iterations or iterations
        tolerance = solver.tolerance or tolerance
    try:
        horizon = Sampling(program.sample_time, findings).samples(section.horizon)
    except LoweringFailed:
        return None
    return MovingWindow(
        horizon=horizon,
        is_fixed=mode == "fixed",
        iterations=iterations,
        tolerance=tolerance,
    )


def check_size(problem: EstimationProblem, section: MovingHorizon, findings: Findings) -> None:
    """Reports E1127 if the estimator's working arrays would need more than `TOO_LONG` bytes.

    Each of their numbers takes 8 bytes.
    """
    control = window_problem(problem).control
    memory = numbers_of(control, "staged") * 8
    if memory > TOO_LONG:
        told = f"about {memory / 2**20:,.0f} MiB"
        products = estimate(control).staged
        place = section.horizon.span
        findings.report(errors.window_of_memory(control.horizon - 1, told, products, place))


def _check_something_moves(section: MovingHorizon, findings: Findings) -> None:
    """Reports a window without uncertain states or parameters, which has nothing to estimate."""
    deviations = (*section.initial.values(), *section.process.values())
    if not section.parameters and not any(std.value > 0 for std in deviations):
        findings.report(errors.nothing_uncertain(section.place.key))
