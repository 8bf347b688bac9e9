"""`linear`: a weighted sum over the elements of a value, sample by sample."""

from __future__ import annotations

import numpy as np

from compiler.layers.layer_context import LayerContext
from compiler.program import NodeId
from compiler.scalar_functions import Array
from compiler.types import UNNAMED, WINDOW, Axis


def linear(
    context: LayerContext, value: NodeId, out: Axis | None, bias: bool, initial: Array | None
) -> NodeId:
    """y[o] = Σᵢ W[o, i] · x[i] (+ b[o]), with i the last axis of x besides the window.

    A scalar x counts as one element. The default initial weights are uniform in ±1/n.
    """
    builder = context.builder
    axes = tuple(axis for axis in builder.type(value).axes if axis.name != WINDOW)
    if not axes:
        lone = (Axis(UNNAMED, 1), *builder.type(value).axes)
        value = builder.reshape(value, lone)
        axes = (Axis(UNNAMED, 1),)
    summed = axes[-1]
    rows = (out,) if out else ()
    weight_axes = (*rows, summed)
    bound = 1.0 / summed.size
    start = context.small_random("weight", weight_axes, bound) if initial is None else initial
    weight = context.learned("weight", weight_axes, start, "one row of weights for each output")
    result = builder.contract(weight, value)
    if bias:
        result = builder.add(result, context.learned("bias", rows, np.zeros(()), "offset"))
    return result
