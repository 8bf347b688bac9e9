"""Takes the losses of a program that are sums of squares, roots of them included."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from compiler.differentiation.sums_of_squares import is_sum_of_squares
from compiler.differentiation.training_step import element_factors
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import Loss, Measure, Program

NUMBER_OF = "number of "
"""Before the name of a loss: one that counts its residuals."""


def squared(program: Program, weights: Mapping[str, float]) -> Program:
    """The program with the losses that count, each as mse."""
    losses: list[Loss] = []
    for loss in program.losses:
        if loss.measure is Measure.RMSE or is_sum_of_squares(program.step, loss):
            compared = loss.target is not None
            measure = Measure.MSE if compared else loss.measure
            if weights[loss.name]:
                losses.append(replace(loss, measure=measure))
    builder = GraphBuilder(program.step)
    counted = [_counted(builder, one) for one in losses if one.rows is not None]
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
