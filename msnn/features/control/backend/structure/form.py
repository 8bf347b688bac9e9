"""Says what a structure of the solver decides: its derivatives, arrays and tables."""

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
    """The layout of a controller's plan: number i of (x, u) at stage k in z[places[i] + step k]."""

    structure: Chosen
    places: tuple[int, ...]
    step: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Addresses:
    """The addresses of numbers in templates; each is a text with places for its indices."""

    stage: str
    """The numbers of an array that a stage reads, of the array and the stage."""
    state: str
    """Where among them a state is."""
    memory: str
    """Where a number of x is."""
    control: str
    measured: str
    """What was measured of a state."""
    has_blocks: bool
    """Whether controls stay the same over several samples."""

    # called by the templates of `mpc/`, with C in place of the numbers
    def of_stage(self, array: str, k: str) -> str:
        return self.stage.format(array, k)

    def of_state(self, i: str) -> str:
        return self.state.format(i)

    def of_memory(self, i: str) -> str:
        return self.memory.format(i)

    def of_control(self, i: str) -> str:
        return self.control.format(i)

    def of_measured(self, i: str) -> str:
        return self.measured.format(i)

    def of_block(self, k: str) -> str:
        """The block of a stage."""
        return f"BLOCK[{k}]" if self.has_blocks else k

    def of_begin(self, block: str) -> str:
        """The stage at which a block begins."""
        return f"BEGIN[{block}]" if self.has_blocks else block

    def of_decided(self, k: str) -> str:
        """The count of numbers that are decided before a stage."""
        return f"DECIDED_BEFORE[{k}]" if self.has_blocks else f"{k} * CONTROLS"

    def of_tightest(self, k: str, side: str) -> str:
        """The stage whose limit holds the control of a stage."""
        return f"tightest(c, {k}, {side})" if self.has_blocks else k


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """A problem in the form of one structure."""

    stages: Stages
    stage: StageArrays
    terminal: StageArrays
    steady: PlacedMatrix | None
    """Slopes that are the same along the horizon, where the structure tells them apart."""
    shapes: Mapping[str, tuple[int, ...]]
    """Arrays of the solver that hang on the structure."""
    places_of_memory: tuple[int, ...]
    """Where a stage finds the numbers of x."""
    newest: tuple[int, ...]
    """The numbers of x that have gaps from stage to stage."""
    plan: PlanLayout
    addresses: Addresses
    facts: Mapping[str, Any]
    """Sizes and tables for the templates."""
