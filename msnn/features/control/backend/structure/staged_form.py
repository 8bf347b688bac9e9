"""Brings a problem into staged form, which a Riccati recursion over the stages solves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from backends.c_language.places import c_strides
from compiler.hessian.step_derivatives import StepDerivatives, next_value
from compiler.ir.types import Type
from msnn.features.control.backend.stage_code.array_places import Place, PlacedMatrix
from msnn.features.control.backend.stage_code.stage_functions import StageArrays
from msnn.features.control.backend.structure.form import (
    Addresses,
    Form,
    PlanLayout,
    Stages,
    numbers_of,
    stages_of_problem,
)
from msnn.features.control.backend.structure.rows import Rows
from msnn.features.control.problem.optimal_control import ControlProblem


def staged_form(problem: ControlProblem, rows: Rows) -> Form:
    """Builds the staged form of a problem: the plan is an array (N + 1, nx + nu) of (x, u)."""
    nx, nu = problem.states.size, problem.controls.size
    names = [member.name for member in problem.states.members]
    following = [(next_value(member.name), member.size) for member in problem.states.members]
    stages = stages_of_problem(problem, problem.program, rows, following, names)
    count, width = problem.horizon + 1, nx + nu
    return Form(
        stages=stages,
        stage=_arrays(problem, stages, stages.stage, stages.results),
        terminal=_arrays(problem, stages, stages.terminal, stages.terminal_results),
        steady=None,
        shapes={
            # stage N has elements for controls, too, so that all rows have one width
            "z": (count, width),
            "dz": (count, width),
            "gradient": (count, width),
            "adjoint": (count, nx),
            "slopes": (count, stages.size, width),
            "curvature": (count, width, width),
            "gain": (problem.horizon, nu, nx),
            "advance": (problem.horizon, nu),
        },
        places_of_memory=tuple(range(nx)),
        newest=tuple(range(nx)),
        plan=PlanLayout("staged", tuple(range(width)), width),
        addresses=Addresses(
            stage="c->{}[{}]",
            state="{}",
            memory="{}",
            control="STATES + {}",
            measured="c->measured[{}]",
            has_blocks=problem.has_blocks,
        ),
        facts={"plain": 0, "read_numbers": list(range(width))},
    )


def _arrays(
    problem: ControlProblem,
    stages: Stages,
    derivatives: StepDerivatives,
    results: Mapping[str, int],
) -> StageArrays:
    """Returns the array layout of the stage, or end of the horizon, with these derivatives.

    `results` maps each result to its first row in the Jacobian.
    """
    width = problem.states.size + problem.controls.size
    # the end of the horizon has only some of these rows
    of_results = [results[m.name] + i for m in derivatives.results.members for i in range(m.size)]
    numbers = numbers_of(problem, derivatives.variables)
    firsts = [(member, member.first) for member in problem.states.members]
    firsts += [(m, problem.states.size + m.first) for m in problem.controls.members]
    assert derivatives.hessian is not None

    def placed(array: str, rows: Sequence[int] | NDArray[np.int64]) -> PlacedMatrix:
        """Returns the layout of an array whose matrix rows have these indices."""
        matrix = derivatives.jacobian if array == "slopes" else derivatives.hessian
        assert matrix is not None
        # the part of the array that is set to 0 before entries are written, unused rows included
        first, last = (min(rows) * width, (max(rows) + 1) * width) if len(rows) else (0, 0)
        return PlacedMatrix(array, matrix, np.asarray(rows, int) * width, numbers, first, last)

    return StageArrays(
        variables={m.name: Place("z", first, c_strides(Type(m.axes).shape)) for m, first in firsts},
        results=results,
        given=stages.given,
        slopes=placed("slopes", of_results),
        curvature=placed("curvature", numbers),
    )
