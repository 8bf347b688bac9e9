"""Bounds the estimates: parameters by `min` and `max`, states by their declared ranges.

Bounds of parameters are hard: a window whose start and noise are 0 keeps them. A range of a state
can be left by what the model itself does, so that it is soft by an exact penalty.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Declared, Output, Program, State
from compiler.ir.types import Type
from msnn.features.control.problem.optimal_control.problem import Limits, PathLimits
from msnn.features.control.problem.state_estimation.problem import EstimationProblem


def with_limits(
    problem: EstimationProblem, program: Program, scales: Mapping[str, float]
) -> tuple[Program, tuple[PathLimits, ...]]:
    """The program with an output for each bounded value and limit, and the limits."""
    builder = GraphBuilder(program.step)
    outputs = list(program.outputs)
    paths: list[PathLimits] = []
    for state in program.states:
        ends = _ends(problem, state)
        if ends == (None, None):
            continue
        names: list[str | None] = []
        for word, end in zip(("least", "most"), ends, strict=True):
            names.append(None if end is None else f"{word} {state.name}")
            if end is not None:
                outputs.append(
                    Output(f"{word} {state.name}", builder.constant(end, unit=state.unit))
                )
        # no name of a spec has a blank: outputs of the window meet none of the model
        value = f"bounded {state.name}"
        outputs.append(Output(value, builder.state(state.name, Type(state.axes, state.unit))))
        paths.append(
            PathLimits(
                name=state.name,
                value=value,
                limits=Limits(minimum=names[0], maximum=names[1]),
                reads_control=False,
                hard=state.name in problem.parameters,
                linear=None,
                quadratic=None,
                scale=scales[state.name],
                span=state.span,
            )
        )
    return replace(program, step=builder.graph(), outputs=tuple(outputs)), tuple(paths)


def _ends(problem: EstimationProblem, state: State) -> tuple[float | None, float | None]:
    if state.name in problem.parameters:
        numbers = problem.parameters[state.name]
        return numbers.minimum, numbers.maximum
    origin = problem.program.state(state.name).origin
    # registers hold samples of others: limits would be said twice
    return state.range if state.range is not None and isinstance(origin, Declared) else (None, None)
