"""Defines the interface of training engines, and the random dropout factors of an epoch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from compiler.differentiation.estimated_starts import estimated_states, start_signal
from compiler.ir.types import Type
from compiler.passes.draw_dropout import Mask
from msnn.data.dataset import FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import LossSum
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.plans.stage_result import EstimatedStarts

LossSums = dict[str, LossSum]


def batches_of(runs: Runs, size: int) -> Iterator[Runs]:
    """The rollouts in batches of `size`, in order."""
    for start in range(0, len(runs), size):
        yield runs.take(np.arange(start, min(start + size, len(runs))))


class NonFiniteLossError(Exception):
    """The loss of a batch, its gradient, or an updated parameter is infinite or NaN.

    `runs` are the rollouts of the batch. `slopes` names the parameters with a non-finite
    derivative, if known.
    """

    def __init__(self, runs: Runs, slopes: tuple[str, ...] = ()) -> None:
        super().__init__("the loss of a batch is not finite")
        self.runs, self.slopes = runs, slopes


@dataclass(frozen=True, slots=True)
class EngineState:
    """The state of an engine from which training continues with identical bits: arrays and JSON
    values.
    """

    arrays: Mapping[str, FloatArray]
    structure: object


class Engine(Protocol):
    """An implementation of the training of one stage: it holds the parameters, optimiser and data.

    `NativeEngine`, `TorchEngine` and `LevenbergMarquardtEngine` have these methods. Losses are
    returned as sums and counts (`LossSums`), by name of the loss.
    """

    def weights(self) -> dict[str, FloatArray]:
        """The physical values of all parameters, by name."""
        ...

    def begin_epoch(self, epoch: int, rate: float, attempt: int = 0, spread: float = 0.0) -> None:
        """Draws the dropout masks of an epoch, and sets learning rates to `rate` times those of the
        stage.

        Priors are weighted by `spread`, the mean square of the residuals divided by their number.
        Repeated calls draw the same masks; each `attempt` at the stage (`starts:`) draws its own.
        """
        ...

    def write(self, series: Mapping[str, FloatArray], *, watched: bool) -> None:
        """Overwrites series that hold estimated initial states: (rows, *shape) by name of the
        series.

        They are read by the rollouts of the monitor if `watched`, else by those of training.
        """
        ...

    def measure(self, runs: Runs) -> LossSums:
        """The losses of training rollouts at the current weights, without dropout, as sums and
        counts.
        """
        ...

    def order(self, count: int, key: int) -> IntArray:
        """The shuffled indices 0 … count−1 of an epoch's rollouts; `key` seeds the shuffle
        (`epochs.shuffled`).
        """
        ...

    batches_a_call: int
    """Maximum number of batches per call of `train_batches`; a stage can stop between two calls."""

    def train_batches(
        self,
        runs: Runs,
        size: int,
        members: IntArray | None = None,
        before: LossSums | None = None,
    ) -> LossSums:
        """Takes one optimiser step per batch of `size` rollouts; the last batch may be smaller.

        `members` are the indices of the training rollouts in order; by default all in sequence.
        Returns the losses before each step, added to `before`, the losses of earlier batches.
        Weights and losses have the same bits for any division of an epoch into calls. Raises
        NonFiniteLossError.
        """
        ...

    left_out: int
    """Batches of the last call that were skipped because of infinite derivatives (decision
    0184).
    """

    has_left_out: bool
    """True if some batch or residual was skipped so far because of infinite derivatives."""

    finished: str | None
    """The reason why further batches would change nothing; None while training can continue."""

    def evaluate(self, runs: Runs) -> LossSums:
        """The losses of these rollouts at the current weights, on the rows of the monitor's set."""
        ...

    def state(self) -> EngineState:
        """A copy of the parameters and of the optimiser's state, for a checkpoint."""
        ...

    def restore(self, state: EngineState) -> None:
        """Sets parameters and optimiser to a state that `state` returned in the same stage."""
        ...


@runtime_checkable
class StartsEstimator(Protocol):
    """An engine that can estimate the initial states of runs together with the parameters."""

    def starts(self) -> EstimatedStarts | None:
        """The current initial states of the training rollouts; None if the engine does not estimate
        them.
        """
        ...


def own_series(plan: StagePlan, series: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The series of a stage, with arrays of its own for those that the stage overwrites.

    These are the dropout factors, all set to 1, and the estimated initial states, all set to 0.
    Each is (rows, *shape).
    """
    rows = len(next(iter(series.values()), np.zeros(0)))
    states = () if plan.rollout.starts is None else estimated_states(plan.rollout.starts.program)
    blank = {start_signal(s.name): np.zeros((rows, *Type(s.axes).shape)) for s in states}
    return {**with_all_kept(series, plan.masks), **blank}


def without_masks(plan: StagePlan, series: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The series without dropout factors: evaluations use no dropout."""
    masks = {mask.signal for mask in plan.masks}
    return {name: values for name, values in series.items() if name not in masks}


def with_all_kept(series: Mapping[str, FloatArray], masks: Sequence[Mask]) -> dict[str, FloatArray]:
    """The series with all dropout factors set to 1."""
    rows = len(next(iter(series.values()), np.zeros(0)))
    return {**series, **{mask.signal: np.ones((rows, mask.size)) for mask in masks}}


def factors_of(
    plan: StagePlan, series: Mapping[str, FloatArray], epoch: int, attempt: int = 0
) -> dict[str, FloatArray]:
    """The random dropout factors of an epoch: for each mask an array (rows, elements) of 0 or 1/(1
    − rate).

    The generator is Philox (Salmon et al. 2011), seeded by the stage's seed and index, epoch,
    attempt and mask. A step at row t uses the factors of row t, in any rollout.
    """
    found: dict[str, FloatArray] = {}
    rows = len(next(iter(series.values()), np.zeros(0)))
    for number, mask in enumerate(plan.masks):
        key = np.random.SeedSequence([plan.seed, plan.index, epoch, attempt, number])
        source = np.random.Philox(key)
        draws = np.random.Generator(source).random((rows, mask.size))
        found[mask.signal] = np.where(draws < mask.rate, 0.0, 1.0 / (1.0 - mask.rate))
    return found
