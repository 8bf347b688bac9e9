"""Says what an engine of rollouts does, whoever computes."""

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
"""What is always there to simulate with."""

ExportName: TypeAlias = Literal["onnx", "casadi", "c", "fmu"]
"""Exports that data can be run through."""

Advance: TypeAlias = Callable[[int], None]
"""Is told now and then how many more steps of rollouts are done."""


class RolloutEngine(Protocol):
    """Runs rollouts of one program, its loops closed, with one set of weights over one log."""

    def outputs(self, runs: Runs, advance: Advance) -> Mapping[str, FloatArray]:
        """Every output of the program, (Σ steps, *shape): one rollout after the other."""
        ...

    def losses(
        self, runs: Runs, skip: int, scored: Mapping[str, BoolArray] | None, advance: Advance
    ) -> dict[str, LossSum]:
        """Every loss of the program from evaluation `skip` on, on the rows that are `scored`."""
        ...


@dataclass(frozen=True, slots=True)
class OpenedRollouts:
    """An engine that is ready, which one it is, and what the user should know of the choice."""

    engine: RolloutEngine
    name: str
    """Of `EngineName` or `ExportName`."""
    notes: tuple[Diagnostic, ...] = ()


@dataclass(frozen=True, slots=True)
class EngineToOpen:
    """An engine that is made elsewhere, for a program whose loops are closed, weights and a log."""

    open: Callable[[Program, Mapping[str, FloatArray], Mapping[str, FloatArray]], OpenedRollouts]


Engine: TypeAlias = str | EngineToOpen
"""A name that `open_rollouts` knows, or an engine that is made elsewhere."""


def first_places(runs: Runs) -> IntArray:
    """The place of each rollout's first step in the results of `outputs`."""
    return np.cumsum(runs.steps) - runs.steps
