"""Records how a stage of training ended."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from msnn.data.dataset import FloatArray, IntArray

Weights = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatedStarts:
    """The initial states of rollouts, as training has estimated them together with the
    parameters.
    """

    t0: IntArray
    """(runs,): the row in which each run begins."""
    steps: IntArray
    """(runs,): the number of steps of each run."""
    values: Mapping[str, FloatArray]
    """(runs, *shape) per state."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageResult:
    """The result of a stage: its best weights and the epoch that reached them.

    Epoch 0 means that the initial weights were the best.
    """

    best: Weights
    best_value: float
    best_epoch: int
    epochs: int
    reason: str
    seconds: float
    attempt: int
    """Index of the attempt, from 0."""
    starts: EstimatedStarts | None = None
    """The initial states that belong to the best weights; None if they are not estimated."""


def monitor_order(value: float) -> tuple[bool, float]:
    """Sort key of monitor values, best first; non-finite values come last.

    With `<` alone, a NaN in the first place would never be replaced.
    """
    return not math.isfinite(value), value
