"""Takes the losses of a program that are sums of squares, roots of them included."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from compiler.differentiation.sums_of_squares import is_sum_of_squares
from compiler.ir.program import Loss, Measure, Program


def squared(program: Program, weights: Mapping[str, float]) -> Program:
    """The program with the losses that count, each as mse."""
    losses: list[Loss] = []
    for loss in program.losses:
        if loss.measure is Measure.RMSE or is_sum_of_squares(program.step, loss):
            compared = loss.target is not None
            measure = Measure.MSE if compared else loss.measure
            if weights[loss.name]:
                losses.append(replace(loss, measure=measure))
    return replace(program, losses=tuple(losses))
