"""Defines the interface of rollout engines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

import numpy as np

from compiler.ir.program import Program
from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.data.starts import Runs
from msnn.simulation.rollout import LossSum
from spec_schema.diagnostics.diagnostic import Diagnostic

EngineName: TypeAlias = Literal["interpreter", "native", "torch"]
"""Engines that need no export."""

ExportName: TypeAlias = Literal["onnx", "casadi", "c", "fmu"]
"""Exports that can simulate data."""

Advance: TypeAlias = Callable[[int], None]
"""Callback with the number of further completed steps."""


class RolloutEngine(Protocol):
    """Runs rollouts of one closed-loop program with one set of weights on one dataset."""

    def outputs(self, runs: Runs, advance: Advance) -> Mapping[str, FloatArray]:
        """Every output of the program, (Σ steps, *shape), rollout after rollout."""
        ...

    def losses(
        self, runs: Runs, skip: int, scored: Mapping[str, BoolArray] | None, advance: Advance
    ) -> dict[str, LossSum]:
        """Every loss of the program, over steps from `skip` on and over rows that are `scored`."""
        ...


@dataclass(frozen=True, slots=True)
class OpenedRollouts:
    """An opened engine with its name, and notes for the user about the selection."""

    engine: RolloutEngine
    name: str
    """One of `EngineName` or `ExportName`."""
    notes: tuple[Diagnostic, ...] = ()


@dataclass(frozen=True, slots=True)
class EngineToOpen:
    """A factory of an engine, called with a closed-loop program, weights and data."""

    open: Callable[[Program, Mapping[str, FloatArray], Mapping[str, FloatArray]], OpenedRollouts]


Engine: TypeAlias = str | EngineToOpen
"""A name for `open_rollouts`, or a factory."""


def first_places(runs: Runs) -> IntArray:
    """The position of each rollout's first step in the results of `outputs`."""
    return np.cumsum(runs.steps) - runs.steps
