"""Defines the data that differ between staged and condensed solvers; differentiates stages."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.hessian.step_derivatives import StepDerivatives, step_derivatives
from compiler.ir.program import Program
from compiler.jacobian.matrices import Vector, vector_of
from msnn.features.control.backend.stage_code.array_places import PlacedMatrix
from msnn.features.control.backend.stage_code.stage_functions import StageArrays
from msnn.features.control.backend.structure.rows import Rows
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.structure import Chosen


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


@dataclass(frozen=True, slots=True)
class PlanLayout:
    """The layout of a plan: element i of (x, u) at stage k is z[places[i] + step · k]."""

    structure: Chosen
    places: tuple[int, ...]
    step: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Addresses:
    """Format strings of C expressions that address elements of the solver's arrays.

    Each has one `{}` per argument.
    """

    stage: str
    """The part of an array that a stage reads; arguments are the array and the stage."""
    state: str
    """The index of state i within that part."""
    memory: str
    """The index of element i of x within that part."""
    control: str
    """The index of control i within that part."""
    measured: str
    """The measured value of state i."""
    has_blocks: bool
    """True if controls stay constant over several samples (move blocking)."""

    # the templates of `mpc/` call these; arguments are C expressions
    def of_stage(self, array: str, k: str) -> str:
        """Returns the C expression of the part of an array that stage k reads."""
        return self.stage.format(array, k)

    def of_state(self, i: str) -> str:
        """Returns the C expression of the index of state i in that part."""
        return self.state.format(i)

    def of_memory(self, i: str) -> str:
        """Returns the C expression of the index of element i of x in that part."""
        return self.memory.format(i)

    def of_control(self, i: str) -> str:
        """Returns the C expression of the index of control i in that part."""
        return self.control.format(i)

    def of_measured(self, i: str) -> str:
        """Returns the C expression of the measured value of state i."""
        return self.measured.format(i)

    def of_block(self, k: str) -> str:
        """Returns the C expression of the block of stage k."""
        return f"BLOCK[{k}]" if self.has_blocks else k

    def of_begin(self, block: str) -> str:
        """Returns the C expression of the first stage of a block."""
        return f"BEGIN[{block}]" if self.has_blocks else block

    def of_decided(self, k: str) -> str:
        """Returns the C expression of the number of control elements, over all blocks, decided
        before stage k.
        """
        return f"DECIDED_BEFORE[{k}]" if self.has_blocks else f"{k} * CONTROLS"

    def of_tightest(self, k: str, side: str) -> str:
        """Returns the C expression of the stage with the tightest limit `side` (an index of a
        minimum or maximum) in the block of stage k.
        """
        return f"tightest(c, {k}, {side})" if self.has_blocks else k


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """A problem prepared for one structure of the solver, staged or condensed."""

    stages: Stages
    stage: StageArrays
    terminal: StageArrays
    steady: PlacedMatrix | None
    """Jacobian columns that are constant along the horizon; None if the form has none."""
    shapes: Mapping[str, tuple[int, ...]]
    """Shapes of the solver's arrays that depend on the structure, by name."""
    places_of_memory: tuple[int, ...]
    """The index in the array `z` of each element of x at stage 0."""
    newest: tuple[int, ...]
    """Indices of the elements of x that are states of the solver.

    Only these have a gap, the residual of the dynamics, between stages.
    """
    plan: PlanLayout
    addresses: Addresses
    facts: Mapping[str, Any]
    """Sizes and tables for the templates."""
