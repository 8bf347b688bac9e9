"""`fir`: a finite impulse response filter, a weighted sum over a time window."""

from __future__ import annotations

from compiler.ir.program import NodeId
from compiler.ir.types import WINDOW, Axis, describe_axes
from compiler.layers.rules.arguments import named_array, read_window
from compiler.layers.rules.layer_rule import Arguments, LayerContext, LayerRule
from spec_schema.errors import shapes
from spec_schema.fields.leaf import Located
from spec_schema.sections.layer_kinds import Fir


def fir(context: LayerContext, settings: Fir, arguments: Arguments) -> NodeId:
    """y[o, e] = Σₖ W[o, e, k] · x[e, t−n+1+k] (+ b[o, e]), with k = 0 … n−1: the weights (taps) of
    the oldest sample come first.

    The argument x has a window of n samples, its own or that of `window:`. Each element e of a
    vector has its own taps; `out` adds an axis o. The arrays W and b are called `weight` and
    `bias`; the bias exists only with `bias: true` and is initially 0. The default initial taps are
    uniform in ±1/(2n): a loop closed over the filter is stable for any draw, since Σ|W| ≤ 1/2.
    `weight: W` and `bias: b` take named parameters of these axes instead, which other layers can
    share. `dropout` is the share of elements of y that training drops at random.
    """
    (window,) = arguments
    builder = context.builder
    taps = builder.type(window).window
    assert taps is not None
    elements, out = context.elements(window), context.out(settings.out)
    if out and out[0] in elements:
        wanted, found = f"without `{out[0].name}`, its `out:`", describe_axes(elements)
        place = context.call.arguments[0].span
        context.refuse(shapes.wrong_axes(f"the argument of `{context.name}`", wanted, found, place))
    rows = (*out, *elements)
    axes = (*rows, Axis(WINDOW, taps))
    if settings.weight is not None:
        weight = named_array(context, settings.weight, axes)
    else:
        start = context.initial("weight", settings.init, axes, 0.5 / taps)
        weight = context.learned("weight", axes, start, "taps, oldest sample first")
    result = builder.contract_over(weight, window, WINDOW)
    if isinstance(settings.bias, Located):
        result = builder.add(result, named_array(context, settings.bias, rows))
    elif settings.bias:
        result = builder.add(result, context.learned("bias", rows, 0.0, "offset"))
    return context.dropout(result, settings.dropout)


FIR = LayerRule(Fir, read_window, fir)
