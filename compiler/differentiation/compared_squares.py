"""Converts all losses with a target to mean squared errors, and adds sums of squared targets."""

from __future__ import annotations

from dataclasses import replace

from compiler.differentiation.training_step import element_factors
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import Loss, Measure, NodeId, Program

SIZE_OF = "size of "
"""Prefix of the loss that sums the squared targets of another loss."""


def compared_squares(program: Program) -> Program:
    """Replaces losses with a target by their mse, and adds a loss with the squares of each target.

    The estimation of initial states uses these squares, whatever the measure of the loss.
    """
    builder = GraphBuilder(program.step)
    losses: list[Loss] = []
    sizes: list[Loss] = []
    for loss in program.losses:
        if loss.target is not None and loss.measure is not Measure.MEAN:
            losses.append(replace(loss, measure=Measure.MSE))
            square = _square(builder, loss, loss.target)
            # weight 0: it is summed like the others but does not affect the gradient
            sizes.append(
                Loss(
                    name=f"{SIZE_OF}{loss.name}",
                    measure=Measure.MEAN,
                    prediction=square,
                    target=None,
                    weight=0.0,
                )
            )
    return replace(program, losses=(*losses, *sizes), step=builder.graph())


def _square(builder: GraphBuilder, loss: Loss, target: NodeId) -> NodeId:
    """The weighted square of each element of a target; 0 where the target is missing."""
    axes = builder.type(target).axes
    zero = builder.broadcast(builder.constant(0.0), axes)
    # false only for NaN, which marks a missing recording
    there = builder.compare(Relation.LESS_EQUAL, target, target)
    known = builder.select(there, target, zero)
    square = builder.multiply(known, known)
    if loss.rows is None:
        return square
    return builder.multiply(element_factors(builder, loss, loss.rows), square)
