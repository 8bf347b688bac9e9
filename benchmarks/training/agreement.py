"""Checks that all tools train the same model: gradients against float64, losses epoch by epoch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from worker import NATIVE, PEER, TORCH, Worker

GRADIENT_LIMIT = 1e-5
LOSS_LIMIT = 1e-4
EPOCHS = 3


@dataclass(frozen=True, slots=True)
class Agreement:
    """The largest errors: of native gradients against float64, of other tools' losses against
    native ones.
    """

    gradient: float
    losses: dict[str, float]

    def holds_with(self, tool: str) -> bool:
        return self.gradient <= GRADIENT_LIMIT and self.losses.get(tool, 0.0) <= LOSS_LIMIT


def agreement(workers: dict[str, Worker], settings: dict[str, Any]) -> Agreement:
    """Compares gradients at random weights, then losses of epochs from the initial weights."""
    native = workers[NATIVE]
    losses: dict[str, list[float]] = {}
    for name, worker in workers.items():
        worker.reset()
        _, told = worker.epochs(EPOCHS, fixed=True)
        losses[name] = [loss * _told_too_low(settings) for loss in told] if name == PEER else told
        worker.reset()
    deviations = {
        name: max(abs(a - b) / abs(b) for a, b in zip(found, losses[NATIVE], strict=True))
        for name, found in losses.items()
        if name != NATIVE
    }
    return Agreement(_gradient_deviation(native, workers[TORCH], settings), deviations)


def _gradient_deviation(native: Worker, torch: Worker, settings: dict[str, Any]) -> float:
    """max |native − float64| / max |float64| on the first batch, at small random weights."""
    random = np.random.default_rng(4)
    weights = {
        name: random.uniform(-spread, spread, size).tolist()
        for name, (size, spread) in settings["weights"].items()
    }
    single, double = native.gradient(weights), torch.gradient(weights)
    largest = max(abs(x) for values in double.values() for x in values)
    return max(
        abs(a - b) / largest
        for name, values in double.items()
        for a, b in zip(single[name], values, strict=True)
    )


def _told_too_low(settings: dict[str, Any]) -> float:
    """The factor of losses that nnodely reports: it divides those of an epoch by round(starts /
    batch) batches.
    """
    if settings["horizon"] == 1:
        return 1.0
    starts, size = settings["starts"], settings["batch"]
    return round(starts / size) / (starts // size)
