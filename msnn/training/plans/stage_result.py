"""Records how a stage of training ended."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from msnn.data.dataset import FloatArray, IntArray

Weights = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatedStarts:
    """The starts of runs that were unknowns of training, beside the parameters."""

    t0: IntArray
    """(runs,): the row in which each run begins."""
    steps: IntArray
    """(runs,): the evaluations that it has."""
    values: Mapping[str, FloatArray]
    """(runs, *shape) of each state."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageResult:
    """The best weights and where they were found; epoch 0 is what the attempt began with."""

    best: Weights
    best_value: float
    best_epoch: int
    epochs: int
    reason: str
    seconds: float
    attempt: int
    """Which of the stage's attempts this is, from 0."""
    starts: EstimatedStarts | None = None
    """Those beside which the best weights were reached; None where they were no unknowns."""


def monitor_order(value: float) -> tuple[bool, float]:
    """Sorts what a monitor says, the best first: what is not finite leads nothing.

    By `<` alone a first NaN would lead for ever, as nothing is less.
    """
    return not math.isfinite(value), value
