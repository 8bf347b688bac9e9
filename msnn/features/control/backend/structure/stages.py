"""Derives what a solver computes of a stage and of the end of the horizon."""

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
    """Derivatives of a stage and of the end, and where each result stands among those of any."""

    stage: StepDerivatives
    terminal: StepDerivatives
    results: Mapping[str, int]
    terminal_results: Mapping[str, int]
    size: int
    """Of the results: next values of states, the cost, bounded values."""
    given: Vector
    """Disturbances and references of a stage."""


def stages_of_problem(
    problem: ControlProblem,
    program: Program,
    rows: Rows,
    following: Sequence[tuple[str, int]],
    next_states: Sequence[str],
) -> Stages:
    """The stages; `following` are the results that are next values, with their sizes.

    Those that are no next state of the program are outputs of it.
    """
    places: dict[str, int] = {}
    end = 0
    for name, size in following:
        places[name] = end
        end += size
    # cost and terminal cost share one place: stages then differ in their functions alone
    cost = end
    places[problem.stage] = cost
    end += 1
    for path in rows.paths:
        places[path.value] = end
        end += problem.type(path.value).size
    # at the end the terminal cost takes the place of the stage's
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
            # no control acts at N: nothing is derived by it there
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
    """The number of (x, u) for each number of a vector of states and controls."""
    states = {member.name: member.first for member in problem.states.members}
    nx = problem.states.size
    firsts = states | {m.name: nx + m.first for m in problem.controls.members}
    # `concatenate` refuses to join nothing
    parts = [firsts[m.name] + np.arange(m.size) for m in variables.members]
    return np.concatenate([*parts, np.empty(0)]).astype(np.int64)


def _with_outputs(program: Program, names: Sequence[str], flat: Collection[str]) -> Program:
    """The program with outputs of these names, then those that are flat."""
    more = [o for o in program.outputs if o.name in flat and o.name not in names]
    return replace(program, outputs=(*(program.output(name) for name in names), *more))
