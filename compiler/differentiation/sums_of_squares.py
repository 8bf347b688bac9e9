"""Recognises losses that are sums of squares, which Gauss-Newton methods need, and rewrites them in
one form.
"""

from __future__ import annotations

from dataclasses import replace

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Multiply
from compiler.ir.program import Graph, Loss, Measure, Program


def is_sum_of_squares(graph: Graph, loss: Loss) -> bool:
    """True if the loss is a sum of squares: mse, huber, or the square of one value without a target
    (`l2`). `graph` is the step.

    Huber is one by reweighting: e²/2 near zero, and a square with the same derivative beyond δ.
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
    """Replaces every loss that is the square of one value by the mse of this value with the target
    0.

    Before: any form. After: the same values; no loss is a square without a target. Example, before
    and after:

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
