"""`fir`: a finite impulse response filter, a weighted sum over a time window."""

from __future__ import annotations

import numpy as np

from compiler.layers.layer_context import LayerContext
from compiler.program import NodeId
from compiler.scalar_functions import Array
from compiler.types import WINDOW, Axis


def fir(
    context: LayerContext, signal: NodeId, out: Axis | None, bias: bool, initial: Array | None
) -> NodeId:
    """y[o, e] = Σₖ W[o, e, k] · x[e, t−n+1+k] (+ b[o, e]); weights oldest sample first.

    `signal` has a window of n samples; each element e of a vector input has its own row of taps and
    `out` adds an axis o. The default initial taps are uniform in ±1/(2n): a loop closed over the
    filter is stable whatever the draw, since Σ|W| ≤ 1/2.
    """
    builder = context.builder
    type = builder.type(signal)
    taps = type.window
    assert taps is not None
    elements = tuple(axis for axis in type.axes if axis.name != WINDOW)
    rows = ((out,) if out else ()) + elements
    axes = (*rows, Axis(WINDOW, taps))
    start = context.small_random("weight", axes, 0.5 / taps) if initial is None else initial
    weight = context.learned("weight", axes, start, "taps, oldest sample first")
    result = builder.contract(weight, signal)
    if bias:
        result = builder.add(result, context.learned("bias", rows, np.zeros(()), "offset"))
    return result
