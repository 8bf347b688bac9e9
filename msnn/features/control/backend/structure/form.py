"""Defines the data that differ between staged and condensed solvers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from msnn.features.control.backend.stage_code.placed_matrix import PlacedMatrix
from msnn.features.control.backend.stage_code.stage_functions import StageArrays
from msnn.features.control.backend.structure.stages import Stages
from msnn.features.control.problem.optimal_control.structure import Chosen


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
        """Returns the C expression of the number of control elements decided before stage k."""
        return f"DECIDED_BEFORE[{k}]" if self.has_blocks else f"{k} * CONTROLS"

    def of_tightest(self, k: str, side: str) -> str:
        """Returns the C expression of the stage with the tightest limit in the block of stage k."""
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
