"""Expresses losses that are sums of squares by residuals and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from compiler.differentiation.training_step import element_factors, scored_error
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import Loss, Measure, NodeId
from compiler.ir.scalars.slope_products import LARGEST_SLOPE
from compiler.ir.types import Axis


@dataclass(frozen=True, slots=True)
class LossResiduals:
    """A loss as Σ r² over its elements: r and its derivatives ∂r/∂θ, both 0 where nothing is
    scored.

    Both are also 0 where a derivative is infinite, i.e. above `LARGEST_SLOPE` with θ in multiples
    of its scale (decision 0184). The derivative of the sum is exact, 2 Σ r ∂r/∂θ. For huber, r
    contains the weight of its element; rows with factor w have √w times the residual.
    """

    loss: Loss
    values: NodeId
    """Axes (…)."""
    slopes: NodeId
    """∂r/∂θ, axes (LEARNED, …)."""
    left_out: NodeId | None
    """√w where a derivative is infinite, else 0, axes (…); None if none can be infinite."""


@dataclass(frozen=True, slots=True)
class Unsquared:
    """A residual factor · error. Its derivatives treat the factor as constant; None means 1."""

    error: NodeId
    factor: NodeId | None
    root: NodeId | None
    """√ of the row factors, which the factor contains; None means 1."""


def unsquared_residual(builder: GraphBuilder, loss: Loss) -> Unsquared:
    """The residual of a loss that is a sum of squares."""
    assert loss.target is not None, "a loss without a target compares nothing"
    error = scored_error(builder, loss)
    axes = builder.type(error).axes
    root = None
    if loss.rows is not None:
        root = builder.apply("sqrt", element_factors(builder, loss, loss.rows))
    if loss.measure is not Measure.HUBER:
        assert loss.measure is Measure.MSE, "other losses are no sums of squares"
        return Unsquared(error, root, root)
    # |e| ≤ δ: (e/√2)²; beyond, the weight δ/|e| gives the square the derivative of the line
    # (iteratively reweighted least squares; Holland, Welsch 1977).
    limit = builder.broadcast(builder.constant(loss.delta), axes)
    size = builder.maximum(builder.apply("abs", error), limit)
    half = builder.broadcast(builder.constant(0.5 * loss.delta), axes)
    factor = builder.apply("sqrt", builder.divide(half, size))
    return Unsquared(error, factor if root is None else builder.multiply(root, factor), root)


def residual_row(
    builder: GraphBuilder,
    loss: Loss,
    residual: Unsquared,
    slopes: NodeId,
    scales: Sequence[float],
    leaves_out: Callable[[], bool],
) -> LossResiduals:
    """A residual with its derivatives, 0 where these are infinite; `scales` of all LEARNED
    elements.
    """
    directions = builder.type(slopes).axes[0]
    values = _weighted(builder, residual.factor, residual.error)
    slopes = _weighted(builder, residual.factor, slopes, directions)
    if not builder.infinite_values.can_be_infinite(slopes) or not leaves_out():
        return LossResiduals(loss, values, slopes, None)
    # one infinite derivative excludes the residual for all learned elements
    steepness = builder.apply("abs", slopes)
    if any(scale != 1.0 for scale in scales):
        # scaled, since the derivative by a leak in m^3/s/Pa is huge but harmless
        factors = builder.constant(np.array(scales), (directions,), unit=None)
        factors = builder.broadcast(factors, builder.type(steepness).axes)
        steepness = builder.multiply(steepness, factors)
    size = builder.sum(steepness, directions.name)
    axes = builder.type(size).axes
    # false for NaN
    largest = builder.broadcast(builder.constant(LARGEST_SLOPE), axes)
    finite = builder.compare(Relation.LESS_EQUAL, size, largest)
    zero, one = (builder.broadcast(builder.constant(value), axes) for value in (0.0, 1.0))
    everywhere = (directions, *axes)
    nothing = builder.broadcast(builder.constant(0.0), everywhere)
    return LossResiduals(
        loss,
        builder.select(finite, values, zero),
        builder.select(builder.broadcast(finite, everywhere), slopes, nothing),
        builder.select(finite, zero, one if residual.root is None else residual.root),
    )


def _weighted(
    builder: GraphBuilder, factor: NodeId | None, value: NodeId, directions: Axis | None = None
) -> NodeId:
    if factor is None:
        return value
    if directions is not None:
        factor = builder.broadcast(factor, (directions, *builder.type(factor).axes))
    return builder.multiply(value, factor)
