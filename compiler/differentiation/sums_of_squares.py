"""Writes losses as sums of squares for Gauss-Newton methods, and finds those that are none."""

from __future__ import annotations

from dataclasses import replace

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Multiply
from compiler.ir.program import Graph, Loss, Measure, Program


def is_sum_of_squares(graph: Graph, loss: Loss) -> bool:
    """Whether a loss of this step is one: mse, the square of one value (`l2`), or huber.

    Huber is one by reweighting: e²/2 near zero, beyond it the square with the same slope.
    """
    match loss.measure:
        case Measure.MSE | Measure.HUBER:
            return True
        case Measure.MEAN:
            square = graph[loss.prediction]
            same = isinstance(square.op, Multiply) and square.args[0] == square.args[1]
            return same and loss.target is None
        case Measure.RMSE | Measure.MAE:
            return False


def with_compared_squares(program: Program) -> Program:
    """Writes every loss that is a square of one value as its mse against 0.

    Before: any form. After: the same numbers; no loss is a square without a target.

        l2(w)
        mse(w, 0)
    """
    builder = GraphBuilder(program.step)
    losses: list[Loss] = []
    for loss in program.losses:
        if loss.measure is Measure.MEAN and is_sum_of_squares(program.step, loss):
            value = program.step[loss.prediction].args[0]
            zero = builder.constant(0.0, unit=builder.type(value).unit)
            target = builder.broadcast(zero, builder.type(value).axes)
            loss = replace(loss, measure=Measure.MSE, prediction=value, target=target)
        losses.append(loss)
    return replace(program, step=builder.graph(), losses=tuple(losses))
