"""Describes optimal control problems and estimators to people: sizes, limits, solvers."""

from __future__ import annotations

from compiler.ir.ops import Constant
from compiler.ir.program import History, Tape
from compiler.ir.types import Type, describe_axes
from compiler.jacobian.matrices import Vector
from msnn.features.control.problem.horizon import stages_of
from msnn.features.control.problem.optimal_control import ControlProblem, Limits
from msnn.features.control.problem.state_estimation import (
    EstimatedNumbers,
    EstimationProblem,
)
from msnn.features.control.problem.structure import chosen_structure, estimate
from msnn.tables import count, table_text


def control_text(problem: ControlProblem) -> str:
    """The sizes, inputs, limits and solver of a controller as text, for `msnn show`."""
    sections = [_sizes(problem), _given(problem), _limits(problem), _solver(problem)]
    return "\n\n".join(section for section in sections if section)


def _sizes(problem: ControlProblem) -> str:
    n = problem.horizon
    parts = ", ".join(
        (
            count(problem.controls.size, "control"),
            f"{count(problem.states.size, 'number')} of memory",
            f"horizon of {count(n, 'sample')} ({n * problem.sample_time:g} s)",
        )
    )
    kept = [_register(name, origin) for name, origin in problem.registers.items()]
    listed = f"\nshift registers: {', '.join(kept)}" if kept else ""
    blocks = f"\nblocks: {', '.join(map(str, problem.blocks))}" if problem.has_blocks else ""
    return f"predictive controller: {parts}{listed}{blocks}"


def _register(name: str, origin: History | Tape) -> str:
    return f"{name} (of {origin.source if isinstance(origin, History) else origin.signal})"


def _given(problem: ControlProblem) -> str:
    parts = (
        ("control", problem.controls, "decided"),
        ("measured disturbance", problem.disturbances, ""),
        ("reference", problem.references, ""),
    )
    rows = [row for kind, vector, how in parts for row in _members(problem, kind, vector, how)]
    return table_text(("name", "is a", "unit", "shape", "along the horizon"), rows)


def _members(
    problem: ControlProblem, kind: str, vector: Vector, how: str
) -> list[tuple[str, str, str, str, str]]:
    rows: list[tuple[str, str, str, str, str]] = []
    samples = problem.horizon + (vector is problem.references)
    for member in vector.members:
        known = f"{samples} samples given" if member.name in problem.previewed else "held"
        unit = "" if member.unit is None else member.unit.text
        shape = describe_axes(member.axes) if member.axes else ""
        rows.append((member.name, kind, unit, shape, how or known))
    return rows


def _limits(problem: ControlProblem) -> str:
    rows = [
        (
            control.name,
            *_ends(problem, control.limits),
            "" if control.rate is None else f"{control.rate:g} a sample",
            "always holds",
            f"t … t+{problem.horizon - 1}",
        )
        for control in problem.control_limits
        if control.rate is not None or control.limits != Limits(minimum=None, maximum=None)
    ]
    for path in problem.path_limits:
        stages = stages_of(problem, path)
        first, last = stages.start or 0, stages.stop - 1
        kind = "hard" if path.hard else _soft(path.linear, path.quadratic)
        when = f"t{f'+{first}' if first else ''} … t+{last}"
        rows.append((path.name, *_ends(problem, path.limits), "", kind, when))
    return table_text(("bound of", "min", "max", "rate", "kind", "at"), rows) if rows else ""


def _soft(linear: float | None, quadratic: float | None) -> str:
    if linear is None and quadratic is None:
        return "soft, as steep as the cost needs"
    known = [
        f"{'as steep as the cost needs' if weight is None else f'{weight:g}'} {power}"
        for weight, power in ((linear, "· v"), (quadratic, "· v²"))
    ]
    return f"soft, {' + '.join(known)}"


def _ends(problem: ControlProblem, limits: Limits) -> tuple[str, str]:
    ends: list[str] = []
    for name in (limits.minimum, limits.maximum):
        op = None if name is None else problem.program.step[problem.node(name)].op
        known = op.values[0] if isinstance(op, Constant) and len(set(op.values)) == 1 else None
        ends.append("" if name is None else "by references" if known is None else f"{known:g}")
    return ends[0], ends[1]


def _solver(problem: ControlProblem) -> str:
    end = (
        f"until the residual is at most {problem.tolerance:g}, "
        f"{count(problem.most_iterations, 'iteration')} a sample at most"
    )
    if problem.starts_again:
        end += (
            f": {problem.iterations} from the plan before, {problem.iterations} of a second start"
        )
    else:
        end += ", from the plan before alone"
    curvature = {
        "exact": "exact curvature of cost, plant and bounds",
        "gauss_newton": "curvature of the cost alone",
    }[problem.hessian]
    return f"solver: interior point with the {curvature}, {end}\n{_structure(problem)}"


def _structure(problem: ControlProblem) -> str:
    found = estimate(problem)
    nx, decided = problem.states.size, len(problem.blocks) * problem.controls.size
    memory = f"{count(nx, 'number')} of memory"
    if found.states < nx:
        memory += f", of which windows leave {count(found.states, 'state')}"
    ways = {
        "staged": f"stage by stage (staged, a Riccati recursion): about {found.staged:,} products"
        " an iteration; grows with the horizon as N, with the memory as its cube",
        "condensed": f"in {count(decided, 'control')} of the horizon at once (condensed, states"
        f" eliminated): about {found.condensed:,} products; grows with the horizon as its cube,"
        " hardly with the length of windows",
    }
    chosen = chosen_structure(problem)
    other = "staged" if chosen == "condensed" else "condensed"
    why = "fewer products" if problem.structure == "auto" else "the spec says so"
    return (
        f"structure: {chosen}, as {why} ({memory}; products beside the derivatives)\n"
        f"  {ways[chosen]}\n"
        f"  not {ways[other]}"
    )


def estimation_text(problem: EstimationProblem) -> str:
    """The sizes, measurements and estimates of an estimator as text, and the solver of a window,
    for `msnn show`.
    """
    parts = [_estimator_sizes(problem), _measured(problem), _found(problem)]
    if problem.window is not None:
        parts.append(_window_solver(problem))
    return "\n\n".join(parts)


def _estimator_sizes(problem: EstimationProblem) -> str:
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
        limits = "" if state.range is None or not bounds else f"{_range_ends(*state.range)}, soft"
        rows.append((state.name, "state", f"{known.initial:g}", f"{known.drift:g}", limits))
    for name, known in problem.parameters.items():
        ends = _range_ends(known.minimum, known.maximum)
        rows.append((name, "parameter", f"{known.initial:g}", f"{known.drift:g}", ends))
    return table_text(("estimated", "is a", "std at first", "std in 1 s", "bounds"), rows)


def _range_ends(low: float | None, high: float | None) -> str:
    if low is None and high is None:
        return ""
    return f"{'' if low is None else f'{low:g}'} … {'' if high is None else f'{high:g}'}".strip()


def _window_solver(problem: EstimationProblem) -> str:
    from msnn.features.control.problem.structure import estimate
    from msnn.features.control.problem.window_problem import window_problem

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
