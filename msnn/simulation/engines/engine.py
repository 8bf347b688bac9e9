"""Says what an engine of rollouts does, whoever computes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.data.starts import Runs
from msnn.simulation.rollout import LossSum
from spec_schema.diagnostics.diagnostic import Diagnostic

EngineName: TypeAlias = Literal["interpreter", "native", "torch"]

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
    name: EngineName
    notes: tuple[Diagnostic, ...] = ()


def first_places(runs: Runs) -> IntArray:
    """Where the first step of each rollout stands in what `outputs` returns."""
    return np.cumsum(runs.steps) - runs.steps
