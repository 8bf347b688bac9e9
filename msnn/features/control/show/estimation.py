"""Describes an estimator to people: what it measures, what it finds, and how."""

from __future__ import annotations

from compiler.ir.types import Type, describe_axes
from msnn.features.control.problem.state_estimation.problem import (
    EstimatedNumbers,
    EstimationProblem,
)
from msnn.tables import count, table_text


def estimation_text(problem: EstimationProblem) -> str:
    """Tables of measurements and estimates, and the solver of a window."""
    parts = [_sizes(problem), _measured(problem), _found(problem)]
    if problem.window is not None:
        parts.append(_solver(problem))
    return "\n\n".join(parts)


def _sizes(problem: EstimationProblem) -> str:
    parameters = [problem.program.parameter(name) for name in problem.parameters]
    found = problem.states.size + sum(Type(parameter.axes).size for parameter in parameters)
    sizes = f"{count(found, 'number')} estimated, {count(len(problem.measured), 'output')} measured"
    if problem.window is None:
        return f"extended Kalman filter: {sizes}"
    n = problem.window.horizon
    seconds = n * problem.sample_time
    return f"moving-horizon estimator: {sizes}, {count(n, 'sample')} back ({seconds:g} s)"


def _measured(problem: EstimationProblem) -> str:
    rows: list[tuple[str, str, str, str]] = []
    for one in problem.measured:
        type = problem.program.step[problem.program.output(one.value).node].type
        unit = "" if type.unit is None or type.unit.text == "1" else type.unit.text
        shape = describe_axes(type.axes) if type.axes else ""
        rows.append((one.signal, one.name, shape, f"{one.std:g} {unit}".rstrip()))
    return table_text(("measured", "by the output", "shape", "standard deviation"), rows)


def _found(problem: EstimationProblem) -> str:
    bounds = problem.window is not None
    rows: list[tuple[str, ...]] = []
    for state in problem.program.states:
        known = problem.deviations.get(state.name, EstimatedNumbers(initial=0.0, drift=0.0))
        limits = "" if state.range is None or not bounds else f"{_ends(*state.range)}, soft"
        rows.append((state.name, "state", f"{known.initial:g}", f"{known.drift:g}", limits))
    for name, known in problem.parameters.items():
        ends = _ends(known.minimum, known.maximum)
        rows.append((name, "parameter", f"{known.initial:g}", f"{known.drift:g}", ends))
    return table_text(("estimated", "is a", "std at first", "std in 1 s", "bounds"), rows)


def _ends(low: float | None, high: float | None) -> str:
    if low is None and high is None:
        return ""
    return f"{'' if low is None else f'{low:g}'} … {'' if high is None else f'{high:g}'}".strip()


def _solver(problem: EstimationProblem) -> str:
    from msnn.features.control.problem.moving_horizon.window_problem import window_problem
    from msnn.features.control.problem.optimal_control.structure import estimate

    window = problem.window
    assert window is not None
    control = window_problem(problem).control
    if window.is_fixed:
        most = f"{count(window.iterations, 'iteration')} a sample at most"
        end = f"{most}, from the window before alone"
    else:
        end = (
            f"until the residual is at most {window.tolerance:g}, "
            f"{count(control.most_iterations, 'iteration')} a sample at most: {window.iterations} "
            f"from the window before, {window.iterations} of a second start"
        )
    return (
        f"solver: that of controllers, interior point, {end}\n"
        f"structure: staged, {control.horizon} stages that decide on "
        f"{count(control.controls.size, 'number')} of noise each: about "
        f"{estimate(control).staged:,} products an iteration, beside the derivatives"
    )
