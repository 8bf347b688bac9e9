"""Finds the terms of a stage's total: sums of squares, non-smooth penalties and priors.

Priors are Gaussian. With residuals of variance σ², the maximum a posteriori parameters minimise
n/σ² · mse + Σ ((p − mean)/std)², so relative to the mse a prior has weight σ²/n. σ² is estimated
from the residuals. This leads to the minimum of log mse + Σ ((p − mean)/std)²/n, the mode with
unknown σ².

`huber` is not a sum of squares. Its standard errors follow from two sums over its elements with
error e, derivative j, row factor w, and ψ, the derivative of the cost ρ. They are Σ w ψ' jjᵀ, the
curvature, and Σ w² ψ² jjᵀ, the covariance of the gradient. These are the bread and the meat of the
sandwich (Huber 1967, "The behavior of maximum likelihood estimates under nonstandard conditions").
Since ψ is e clipped to ±δ, ψ' is 0 or 1. Both sums are therefore products JᵀJ of a residual, which
every engine computes: of ψ(e) with factor w, and of ρ(e) with factor w².
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.known_terms import KnownTerms, known_terms
from compiler.differentiation.sums_of_squares import is_sum_of_squares
from compiler.differentiation.training_step import element_cost, element_factors
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import Loss, Measure, NodeId, Parameter, Program
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import LossSum
from msnn.training.plans.stage_plan import StagePlan

NUMBER_OF = "number of "
"""Prefix of the name of a loss that counts the residuals of another loss."""

BREAD_OF = "bread of "
"""Prefix for the clipped residuals of a robust loss, whose Jacobian gives its curvature."""

MEAT_OF = "meat of "
"""Prefix for the costs of a robust loss, whose Jacobian gives the covariance of its gradient."""

WITHIN = "within delta of "
"""Prefix for the number of residuals that are not clipped."""


def squared(program: Program, weights: Mapping[str, float], *, robust: bool = False) -> Program:
    """The program with those weighted losses that are sums of squares, each as a mean square
    (`mse`).

    `weights` are those of the losses by name. With `robust`, `huber` is kept, with three additional
    losses for its standard errors.
    """
    builder = GraphBuilder(program.step)
    losses: list[Loss] = []
    for loss in program.losses:
        if not weights[loss.name]:
            continue
        if loss.measure is Measure.RMSE or is_sum_of_squares(program.step, loss):
            compared = loss.target is not None
            keeps = not compared or (robust and loss.measure is Measure.HUBER)
            losses.append(loss if keeps else replace(loss, measure=Measure.MSE))
    counted = [_counted(builder, one) for one in losses if one.rows is not None]
    if robust:
        for loss in [one for one in losses if one.measure is Measure.HUBER]:
            counted += _sandwich(builder, loss)
    return replace(program, losses=(*losses, *counted), step=builder.graph())


def is_all_squared(program: Program, weights: Mapping[str, float]) -> bool:
    """True if all weighted losses are sums of squares or their roots, apart from penalties."""
    counted = [one for one in program.losses if weights[one.name] and one.penalty is None]
    return all(
        one.measure is not Measure.HUBER
        and (one.measure is Measure.RMSE or is_sum_of_squares(program.step, one))
        for one in counted
    )


def _counted(builder: GraphBuilder, loss: Loss) -> Loss:
    """A loss whose sum is the number of residuals of `loss` with a row factor above 0."""
    assert loss.rows is not None
    factors = element_factors(builder, loss, loss.rows)
    axes = builder.type(factors).axes
    one, zero = (builder.broadcast(builder.constant(value), axes) for value in (1.0, 0.0))
    number = builder.select(builder.compare(Relation.LESS, zero, factors), one, zero)
    return Loss(f"{NUMBER_OF}{loss.name}", Measure.MEAN, number, None, weight=0.0)


def _sandwich(builder: GraphBuilder, loss: Loss) -> list[Loss]:
    """Three losses from which the standard errors of a `huber` loss follow.

    They are the clipped residuals as squares, the costs as squares, and the number of unclipped
    residuals.
    """
    assert loss.target is not None, "huber compares with something"
    error = builder.subtract(loss.prediction, loss.target)
    unit, axes = builder.type(error).unit, builder.type(error).axes
    low, high, zero = (
        builder.broadcast(builder.constant(value, unit=unit), axes)
        for value in (-loss.delta, loss.delta, 0.0)
    )
    clipped = builder.minimum(builder.maximum(error, low), high)
    # NaN where nothing was recorded, which marks what is not scored
    known = builder.compare(Relation.LESS_EQUAL, loss.target, loss.target)
    nothing = builder.select(known, zero, loss.target)
    squares = None if loss.rows is None else builder.multiply(loss.rows, loss.rows)
    one, none = (builder.broadcast(builder.constant(value), axes) for value in (1.0, 0.0))
    inside = builder.select(builder.compare(Relation.LESS_EQUAL, error, high), one, none)
    inside = builder.select(builder.compare(Relation.LESS_EQUAL, low, error), inside, none)
    if loss.rows is not None:
        factors = element_factors(builder, loss, loss.rows)
        inside = builder.select(builder.compare(Relation.LESS, none, factors), inside, none)

    def compared(prefix: str, value: NodeId, rows: NodeId | None) -> Loss:
        return Loss(f"{prefix}{loss.name}", Measure.MSE, value, nothing, weight=0.0, rows=rows)

    return [
        compared(BREAD_OF, clipped, loss.rows),
        compared(MEAT_OF, element_cost(builder, loss, error), squares),
        Loss(f"{WITHIN}{loss.name}", Measure.MEAN, inside, None, weight=0.0),
    ]


@dataclass(frozen=True, slots=True)
class ResidualsOfStage:
    """The weighted mean square of a stage's residuals, and their number."""

    square: float
    """Weighted mean square; for MAE and RMSE half of the weighted total."""
    count: float

    @property
    def spread(self) -> float:
        """ŝ²/n, the mean square divided by the number of residuals: the weight of priors."""
        return self.square / self.count if self.count else 0.0


def known_of(plan: StagePlan, parameters: Sequence[Parameter]) -> KnownTerms:
    """The penalties and priors of those of these parameters that the stage trains."""
    return known_terms(parameters, plan.program.losses, plan.loss_weights, plan.trained)


def has_priors(plan: StagePlan) -> bool:
    """True if a trained parameter has a prior."""
    return any(plan.program.parameter(name).prior is not None for name in plan.trained)


def residuals_of(plan: StagePlan, sums: Mapping[str, LossSum], runs: Runs) -> ResidualsOfStage:
    """The residuals behind losses over rollouts; a row in several rollouts counts once."""
    square, count = _scored(plan, sums)
    return ResidualsOfStage(square, count * _once(runs, plan.rollout.skip))


def square_by_count(plan: StagePlan, sums: Mapping[str, LossSum]) -> float:
    """ŝ²/n, the weight of priors, for losses over rollouts that do not overlap."""
    square, count = _scored(plan, sums)
    return square / count if count else 0.0


def distance(plan: StagePlan, weights: Mapping[str, FloatArray]) -> float:
    """How far the trained parameters are from their priors: Σ ((p − mean)/std)²."""
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
