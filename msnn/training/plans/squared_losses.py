"""Converts the losses of a program to sums of squares, including square roots of such sums.

`huber` is not a sum of squares. Its standard errors follow from two sums over its elements with
error e, derivative j, row factor w, and ψ, the derivative of the cost ρ. They are Σ w ψ' jjᵀ, the
curvature, and Σ w² ψ² jjᵀ, the covariance of the gradient. These are the bread and the meat of the
sandwich (Huber 1967, "The behavior of maximum likelihood estimates under nonstandard conditions").
Since ψ is e clipped to ±δ, ψ' is 0 or 1. Both sums are therefore products JᵀJ of a residual, which
every engine computes: of ψ(e) with factor w, and of ρ(e) with factor w².
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from compiler.differentiation.sums_of_squares import is_sum_of_squares
from compiler.differentiation.training_step import element_cost, element_factors
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import Loss, Measure, NodeId, Program

NUMBER_OF = "number of "
"""Prefix of the name of a loss that counts the residuals of another loss."""

BREAD_OF = "bread of "
"""Prefix for the clipped residuals of a robust loss, whose Jacobian gives its curvature."""

MEAT_OF = "meat of "
"""Prefix for the costs of a robust loss, whose Jacobian gives the covariance of its gradient."""

WITHIN = "within delta of "
"""Prefix for the number of residuals that are not clipped."""


def squared(program: Program, weights: Mapping[str, float], *, robust: bool = False) -> Program:
    """The program with its weighted losses, each as mse.

    With `robust`, `huber` is kept, with three additional losses for its standard errors.
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
    """A loss that counts residuals with a positive row factor."""
    assert loss.rows is not None
    factors = element_factors(builder, loss, loss.rows)
    axes = builder.type(factors).axes
    one, zero = (builder.broadcast(builder.constant(value), axes) for value in (1.0, 0.0))
    number = builder.select(builder.compare(Relation.LESS, zero, factors), one, zero)
    return Loss(f"{NUMBER_OF}{loss.name}", Measure.MEAN, number, None, weight=0.0)


def _sandwich(builder: GraphBuilder, loss: Loss) -> list[Loss]:
    """Clipped residuals and costs of a robust loss as squares, and the count of unclipped ones."""
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
