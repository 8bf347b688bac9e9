"""Defines what a training engine must do; stages drive any engine through this alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from msnn.data.dataset import FloatArray, IntArray
from msnn.data.starts import Runs
from msnn.simulation.rollout import LossSum
from msnn.training.plans.stage_result import EstimatedStarts

LossSums = dict[str, LossSum]


def batches_of(runs: Runs, size: int) -> Iterator[Runs]:
    """The rollouts in batches of `size`, in order."""
    for start in range(0, len(runs), size):
        yield runs.take(np.arange(start, min(start + size, len(runs))))


class NonFiniteLossError(Exception):
    """The loss of a batch, its slope, or a parameter after it is infinite or NaN.

    `runs` is the batch; `slopes` names parameters in which the loss has no finite slope, where an
    engine knows them.
    """

    def __init__(self, runs: Runs, slopes: tuple[str, ...] = ()) -> None:
        super().__init__("the loss of a batch is not finite")
        self.runs, self.slopes = runs, slopes


@dataclass(frozen=True, slots=True)
class EngineState:
    """All that an engine needs to go on later bit for bit: arrays by name and a JSON value."""

    arrays: Mapping[str, FloatArray]
    structure: object


class Engine(Protocol):
    """Holds parameters, an optimiser and the data of one stage."""

    def weights(self) -> dict[str, FloatArray]:
        """Physical values of all parameters."""
        ...

    def begin_epoch(self, epoch: int, rate: float, attempt: int = 0, spread: float = 0.0) -> None:
        """Draws what dropout leaves out and sets learning rates to `rate` times those of the stage.

        Priors count by `spread`, ŝ²/n. The same however often it is asked; each `attempt` at the
        stage has its own.
        """
        ...

    def write(self, series: Mapping[str, FloatArray], *, watched: bool) -> None:
        """Replaces series by which runs start: of those that are watched, or trained on."""
        ...

    def measure(self, runs: Runs) -> LossSums:
        """The losses of rollouts to train on at the current weights, nothing left out of them."""
        ...

    def order(self, count: int, key: int) -> IntArray:
        """The order of an epoch of `count` rollouts: that of `epoch_order.shuffled`."""
        ...

    batches_a_call: int
    """Most batches that `train_batches` is given at once; a stage can stop between two calls."""

    def train_batches(
        self,
        runs: Runs,
        size: int,
        members: IntArray | None = None,
        before: LossSums | None = None,
    ) -> LossSums:
        """One optimiser step on each `size` of the rollouts in order, the last ones fewer.

        `members` are those that are trained on, in that order; by default all as they stand.
        Returns the losses before each step, added to those of the batches `before`, one batch
        after the other: weights and losses have the same bits wherever an epoch is divided into
        calls. Raises NonFiniteLossError.
        """
        ...

    left_out: int
    """Batches of the last call without a step, as their slopes are infinite (decision 0184)."""

    has_left_out: bool
    """Whether anything has had no share in a step so far, as its slopes are infinite."""

    finished: str | None
    """Why further batches would change nothing; None as long as they may."""

    def evaluate(self, runs: Runs) -> LossSums:
        """The losses of these rollouts at the current weights, on the rows that count."""
        ...

    def state(self) -> EngineState:
        """Parameters and optimiser as they are now."""
        ...

    def restore(self, state: EngineState) -> None:
        """Goes back to a state of the same stage."""
        ...


@runtime_checkable
class StartsEstimator(Protocol):
    """An engine to which the starts of runs can be unknowns, beside the parameters."""

    def starts(self) -> EstimatedStarts | None:
        """Where the runs that it trains on start now; None where it estimates no starts."""
        ...
