"""Finds what a stage knows of its parameters beside the data: penalties with corners, priors.

A prior is the Gaussian one: with residuals of variance σ² the most probable parameters minimise
n/σ² · mse + Σ ((p − mean)/std)², so that beside the mse it counts by σ²/n. σ² is taken from the
residuals themselves, which leads to the minimum of log mse + Σ ((p − mean)/std)²/n: the mode where
σ² is unknown too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from backends.known_terms import KnownTerms, known_terms
from compiler.ir.program import Loss, Measure, Parameter
from msnn.data.dataset import FloatArray
from msnn.data.starts import Runs
from msnn.simulation.rollout import LossSum
from msnn.training.plans.stage_plan import StagePlan


@dataclass(frozen=True, slots=True)
class ResidualsOfStage:
    """The size of a stage's residuals, and their number."""

    square: float
    """Weighted mean square: of magnitudes and roots half of their weighted total."""
    count: float

    @property
    def spread(self) -> float:
        """ŝ²/n, by which priors count."""
        return self.square / self.count if self.count else 0.0


def known_of(plan: StagePlan, parameters: Sequence[Parameter]) -> KnownTerms:
    """The known terms of these parameters; none of those that the stage does not train."""
    return known_terms(parameters, plan.program.losses, plan.loss_weights, plan.trained)


def has_priors(plan: StagePlan) -> bool:
    """Whether a parameter that moves has one."""
    return any(plan.program.parameter(name).prior is not None for name in plan.trained)


def residuals_of(plan: StagePlan, sums: Mapping[str, LossSum], runs: Runs) -> ResidualsOfStage:
    """The residuals behind losses over rollouts, each row counted once however often scored."""
    square, count = _scored(plan, sums)
    return ResidualsOfStage(square, count * _once(runs, plan.rollout.skip))


def square_by_count(plan: StagePlan, sums: Mapping[str, LossSum]) -> float:
    """ŝ²/n where rollouts score each row once."""
    square, count = _scored(plan, sums)
    return square / count if count else 0.0


def distance(plan: StagePlan, weights: Mapping[str, FloatArray]) -> float:
    """Σ ((p − mean)/std)² of the parameters that move."""
    total = 0.0
    for name in plan.trained:
        prior = plan.program.parameter(name).prior
        if prior is not None:
            total += float(np.sum(((weights[name] - prior.mean) / prior.std) ** 2))
    return total


def _scored(plan: StagePlan, sums: Mapping[str, LossSum]) -> tuple[float, float]:
    square, count = 0.0, 0.0
    for loss in plan.program.losses:
        weight, found = plan.loss_weights[loss.name], sums.get(loss.name, LossSum(0.0, 0))
        if weight and found.count and loss.target is not None:
            square += weight * _part(loss, found)
            count += found.count
    return square, count


def _part(loss: Loss, found: LossSum) -> float:
    """The part of a loss in its likelihood, as the mean square is in that of Gauss."""
    match loss.measure:
        case Measure.MSE | Measure.HUBER:
            return found.value(loss.measure)
        case Measure.RMSE | Measure.MAE:
            return 0.5 * found.value(loss.measure)
        case Measure.MEAN:  # a cross entropy is a likelihood already
            return 0.5


def _once(runs: Runs, skip: int) -> float:
    """The share of the scored steps that has each row once."""
    first, last = runs.t0 + skip, runs.t0 + runs.steps
    used = last > first
    # +1 where a run begins to score, −1 behind its end: rows where the sum is not 0 are scored
    change = np.zeros(int(last.max()) + 1, np.int64)
    np.add.at(change, first[used], 1)
    np.add.at(change, last[used], -1)
    return float(np.count_nonzero(np.cumsum(change)) / np.sum(last[used] - first[used]))
