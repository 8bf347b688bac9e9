"""Adds the variance of outputs to a step, given the covariance of the learned parameters.

To first order an output y(θ) of a rollout has the variance (∂y/∂θ) C (∂y/∂θ)ᵀ. C is the covariance
of θ and ∂y/∂θ the exact derivative over the whole rollout, which the program simulates
(`sensitivities`). With C = L Lᵀ the variance is Σ ((∂y/∂θ) L)², never negative. L is a parameter of
the program, so that one kernel serves every training of a model.
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
"""Prefix of the name of an output with the elementwise variance of another output."""

_DIRECTION = "direction"


def with_variances(program: Program, learned: Sequence[str], outputs: Collection[str]) -> Program:
    """Adds the variances of these outputs that the uncertainty of the parameters `learned` causes.

    Before: window form, loops closed. After: the same, without losses; each output of `outputs`
    that depends on a learned parameter has an additional `VARIANCE` output. Where a derivative is
    infinite, the variance is 0.
    """
    builder = GraphBuilder(program.step)
    compared: list[Loss] = []
    for output in program.outputs:
        if output.name in outputs:
            type = builder.type(output.node)
            zero = builder.broadcast(builder.constant(0.0, unit=type.unit), type.axes)
            # with target 0, the residual is the output itself and has the wanted derivatives
            compared.append(Loss(output.name, Measure.MSE, output.node, zero))
    whole = sensitivities(replace(program, step=builder.graph(), losses=tuple(compared)), learned)
    builder = GraphBuilder(whole.program.step)
    axes = Axis(LEARNED, whole.numbers), Axis(_DIRECTION, whole.numbers)
    root = builder.parameter(ROOT, Type(axes))
    found: list[Output] = []
    for residual in whole.residuals:
        along = builder.contract_over(residual.slopes, root, LEARNED)
        # a sum of squares is never negative; y' C y could be, by rounding
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
