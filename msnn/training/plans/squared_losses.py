"""Takes the losses of a program that are sums of squares, roots of them included.

`huber` is none far from 0. What its estimate is sure of follows from two sums over its elements
with error e, slopes j and factor w of the row, where ψ is the derivative of the cost ρ: Σ w ψ' jjᵀ,
the curvature, and Σ w² ψ² jjᵀ, the covariance of the gradient (the bread and the meat of the
sandwich; Huber 1967, "The behavior of maximum likelihood estimates under nonstandard conditions").
As ψ is e clipped to ±δ, ψ' is 0 or 1, so that both are products of the slopes of a residual, and
every engine has them: of ψ(e) with factor w, and of ρ(e) with factor w².
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
"""Before the name of a loss: one that counts its residuals."""

BREAD_OF = "bread of "
"""Before the name of a robust loss: its clipped residuals, whose slopes make its curvature."""

MEAT_OF = "meat of "
"""The same: its costs, whose slopes make the covariance of its gradient."""

WITHIN = "within delta of "
"""The same: one that counts the residuals that are not clipped."""


def squared(program: Program, weights: Mapping[str, float], *, robust: bool = False) -> Program:
    """The program with the losses that count, each as mse.

    With `robust`, `huber` stays what it is, and has the three losses beside it by which its
    standard errors are computed.
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
    """True if what counts are sums of squares and roots of them, penalties with corners apart."""
    counted = [one for one in program.losses if weights[one.name] and one.penalty is None]
    return all(
        one.measure is not Measure.HUBER
        and (one.measure is Measure.RMSE or is_sum_of_squares(program.step, one))
        for one in counted
    )


def _counted(builder: GraphBuilder, loss: Loss) -> Loss:
    """Counts the residuals of a loss whose rows have factors: none below 0, whatever they are."""
    assert loss.rows is not None
    factors = element_factors(builder, loss, loss.rows)
    axes = builder.type(factors).axes
    one, zero = (builder.broadcast(builder.constant(value), axes) for value in (1.0, 0.0))
    number = builder.select(builder.compare(Relation.LESS, zero, factors), one, zero)
    return Loss(f"{NUMBER_OF}{loss.name}", Measure.MEAN, number, None, weight=0.0)


def _sandwich(builder: GraphBuilder, loss: Loss) -> list[Loss]:
    """Clipped residuals and costs of a robust loss as squares, and the count of what is inside."""
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
