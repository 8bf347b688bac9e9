"""Adds to a step how uncertain its outputs are, given how uncertain the learned numbers are.

To first order an output y(θ) of a rollout has the variance (∂y/∂θ) C (∂y/∂θ)ᵀ, with C the
covariance of θ and ∂y/∂θ the exact slope over the whole rollout, which the program simulates
(`sensitivities`). With C = L Lᵀ that is Σ ((∂y/∂θ) L)², never negative. L is a parameter of the
program, so that one kernel serves every training of a model.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from compiler.differentiation.sensitivities import LEARNED, sensitivities
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Loss, Measure, Output, Parameter, Program
from compiler.ir.types import Axis, Type

ROOT = "root of the covariance"
"""The parameter L, axes (LEARNED, DIRECTION)."""

VARIANCE = "variance of "
"""Before the name of an output: the output with its variance, element by element."""

_DIRECTION = "direction"


def with_variances(program: Program, learned: Sequence[str], outputs: Collection[str]) -> Program:
    """The program with the variances of these outputs that the numbers of `learned` make.

    Before: window form, loops closed. After: the same, without losses; the outputs are
    those of before and one `VARIANCE` output for each of `outputs` that depends on a number.
    Where a slope is infinite the variance is 0.
    """
    builder = GraphBuilder(program.step)
    compared: list[Loss] = []
    for output in program.outputs:
        if output.name in outputs:
            type = builder.type(output.node)
            zero = builder.broadcast(builder.constant(0.0, unit=type.unit), type.axes)
            # beside 0 an output is its own residual, and the slopes of that are the ones wanted
            compared.append(Loss(output.name, Measure.MSE, output.node, zero))
    whole = sensitivities(replace(program, step=builder.graph(), losses=tuple(compared)), learned)
    builder = GraphBuilder(whole.program.step)
    axes = Axis(LEARNED, whole.numbers), Axis(_DIRECTION, whole.numbers)
    root = builder.parameter(ROOT, Type(axes))
    found: list[Output] = []
    for residual in whole.residuals:
        along = builder.contract_over(residual.slopes, root, LEARNED)
        # a sum of squares is never negative, which y' C y by its products could be by rounding
        variance = builder.sum(builder.power(along, 2), _DIRECTION)
        found.append(Output(f"{VARIANCE}{residual.loss.name}", variance))
    size = whole.numbers * whole.numbers
    return replace(
        whole.program,
        step=builder.graph(),
        losses=(),
        outputs=(*program.outputs, *found),
        parameters=(*program.parameters, Parameter(ROOT, axes, None, (0.0,) * size, learn=False)),
    )
