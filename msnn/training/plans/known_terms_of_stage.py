"""Finds the prior knowledge of a stage about its parameters: non-smooth penalties and priors.

Priors are Gaussian. With residuals of variance σ², the maximum a posteriori parameters minimise
n/σ² · mse + Σ ((p − mean)/std)², so relative to the mse a prior has weight σ²/n. σ² is estimated
from the residuals. This leads to the minimum of log mse + Σ ((p − mean)/std)²/n, the mode with
unknown σ².
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
    """The mean square and the number of a stage's residuals."""

    square: float
    """Weighted mean square; for MAE and RMSE half of the weighted total."""
    count: float

    @property
    def spread(self) -> float:
        """ŝ²/n, the weight of priors."""
        return self.square / self.count if self.count else 0.0


def known_of(plan: StagePlan, parameters: Sequence[Parameter]) -> KnownTerms:
    """Penalties and priors of these parameters, as far as the stage trains them."""
    return known_terms(parameters, plan.program.losses, plan.loss_weights, plan.trained)


def has_priors(plan: StagePlan) -> bool:
    """True if a trained parameter has a prior."""
    return any(plan.program.parameter(name).prior is not None for name in plan.trained)


def residuals_of(plan: StagePlan, sums: Mapping[str, LossSum], runs: Runs) -> ResidualsOfStage:
    """The residuals behind losses over rollouts; a row in several rollouts counts once."""
    square, count = _scored(plan, sums)
    return ResidualsOfStage(square, count * _once(runs, plan.rollout.skip))


def square_by_count(plan: StagePlan, sums: Mapping[str, LossSum]) -> float:
    """ŝ²/n if rollouts score each row once."""
    square, count = _scored(plan, sums)
    return square / count if count else 0.0


def distance(plan: StagePlan, weights: Mapping[str, FloatArray]) -> float:
    """Σ ((p − mean)/std)² of the trained parameters."""
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
    """The contribution of a loss to the likelihood, corresponding to the mean square of a
    Gaussian.
    """
    match loss.measure:
        case Measure.MSE | Measure.HUBER:
            return found.value(loss.measure)
        case Measure.RMSE | Measure.MAE:
            return 0.5 * found.value(loss.measure)
        case Measure.MEAN:  # a cross entropy is a likelihood already
            return 0.5


def _once(runs: Runs, skip: int) -> float:
    """Number of distinct scored rows divided by the number of scored steps."""
    first, last = runs.t0 + skip, runs.t0 + runs.steps
    used = last > first
    # +1 where a run begins to score, −1 behind its end: rows where the sum is not 0 are scored
    change = np.zeros(int(last.max()) + 1, np.int64)
    np.add.at(change, first[used], 1)
    np.add.at(change, last[used], -1)
    return float(np.count_nonzero(np.cumsum(change)) / np.sum(last[used] - first[used]))
