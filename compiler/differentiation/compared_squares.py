"""Writes every loss that compares something as sum of squares, and sums those of targets."""

from __future__ import annotations

from dataclasses import replace

from compiler.differentiation.training_step import element_factors
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import Loss, Measure, NodeId, Program

SIZE_OF = "size of "
"""Before the name of a loss: one that sums the squares of its target."""


def compared_squares(program: Program) -> Program:
    """The program with the losses that compare something, each as mse, and the sizes of these.

    What a loss compares decides where runs start, whatever its measure.
    """
    builder = GraphBuilder(program.step)
    losses: list[Loss] = []
    sizes: list[Loss] = []
    for loss in program.losses:
        if loss.target is not None and loss.measure is not Measure.MEAN:
            losses.append(replace(loss, measure=Measure.MSE))
            square = _square(builder, loss, loss.target)
            # of weight 0: it is summed beside the others, and adds no slope
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
    """The square of each element of a target by its factor, 0 where it is missing."""
    axes = builder.type(target).axes
    zero = builder.broadcast(builder.constant(0.0), axes)
    # false for NaN alone, which marks what was not recorded
    there = builder.compare(Relation.LESS_EQUAL, target, target)
    known = builder.select(there, target, zero)
    square = builder.multiply(known, known)
    if loss.rows is None:
        return square
    return builder.multiply(element_factors(builder, loss, loss.rows), square)
