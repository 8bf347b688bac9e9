"""Differentiates the results of a stage and of the end of the horizon for a solver."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from compiler.hessian.step_derivatives import StepDerivatives, step_derivatives
from compiler.ir.program import Program
from compiler.jacobian.matrices import Vector, vector_of
from msnn.features.control.backend.structure.rows import Rows
from msnn.features.control.problem.optimal_control.problem import ControlProblem


@dataclass(frozen=True, slots=True)
class Stages:
    """Derivatives of a stage and of the end of the horizon, and the layout of their results."""

    stage: StepDerivatives
    terminal: StepDerivatives
    results: Mapping[str, int]
    """The index of the first element of each result in the array `results` of a stage."""
    terminal_results: Mapping[str, int]
    """The indices of the results at N; the terminal cost has the index of the stage cost."""
    size: int
    """Number of elements of that array: next values of states, the cost, bounded values."""
    given: Vector
    """Disturbances and references of a stage, stacked."""


def stages_of_problem(
    problem: ControlProblem,
    program: Program,
    rows: Rows,
    following: Sequence[tuple[str, int]],
    next_states: Sequence[str],
) -> Stages:
    """Differentiates the results of a stage and of the end of the horizon.

    `following` has name and size of each result that is a next value of a state: a next state of
    the program or one of its outputs. `next_states` names the states whose next state is a result.
    """
    places: dict[str, int] = {}
    end = 0
    for name, size in following:
        places[name] = end
        end += size
    # stage cost and terminal cost share one index: the solver treats all stages identically
    cost = end
    places[problem.stage] = cost
    end += 1
    for path in rows.paths:
        places[path.value] = end
        end += problem.type(path.value).size
    # the terminal cost replaces the stage cost at the end of the horizon
    of_end = places if problem.terminal is None else {**places, problem.terminal: cost}
    controls = [member.name for member in problem.controls.members]
    outputs = [name for name in places if any(name == output.name for output in program.outputs)]
    at_end = [path.value for path in rows.paths if not path.reads_control]
    at_end += [] if problem.terminal is None else [problem.terminal]
    flat = problem.flat
    return Stages(
        stage=step_derivatives(
            _with_outputs(program, outputs, flat),
            inputs=controls,
            next_states=next_states,
            outputs=outputs,
            flat=flat,
        ),
        terminal=step_derivatives(
            _with_outputs(program, at_end, flat),
            # there is no control at N
            inputs=(),
            next_states=(),
            outputs=at_end,
            flat=flat,
        ),
        results=places,
        terminal_results=of_end,
        size=end,
        given=vector_of(
            "given",
            [
                (m.name, m.axes, m.unit)
                for m in (*problem.disturbances.members, *problem.references.members)
            ],
        ),
    )


def numbers_of(problem: ControlProblem, variables: Vector) -> NDArray[np.int64]:
    """Returns the index in (x, u) of each element of a vector of states and controls."""
    states = {member.name: member.first for member in problem.states.members}
    nx = problem.states.size
    firsts = states | {m.name: nx + m.first for m in problem.controls.members}
    # `concatenate` needs at least one array
    parts = [firsts[m.name] + np.arange(m.size) for m in variables.members]
    return np.concatenate([*parts, np.empty(0)]).astype(np.int64)


def _with_outputs(program: Program, names: Sequence[str], flat: Collection[str]) -> Program:
    """Returns the program with only the outputs of these names, then those named in `flat`."""
    more = [o for o in program.outputs if o.name in flat and o.name not in names]
    return replace(program, outputs=(*(program.output(name) for name in names), *more))
