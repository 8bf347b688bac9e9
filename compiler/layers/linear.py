"""`linear`: a weighted sum over the elements of a value, sample by sample."""

from __future__ import annotations

from compiler.ir.program import NodeId
from compiler.layers.affine import Affine
from compiler.layers.rules.arguments import read_elements
from compiler.layers.rules.layer_rule import Arguments, LayerContext, LayerRule
from spec_schema.sections.layer_kinds import Linear


def linear(context: LayerContext, settings: Linear, arguments: Arguments) -> NodeId:
    """y[o] = Σᵢ W[o, i] · x[i] (+ b[o]), with i the last axis of x besides the window, and o the
    axis `out`.

    A scalar x counts as one element; several arguments are concatenated, all their elements in
    order. The arrays W and b are called `weight` and `bias`; the bias exists unless `bias: false`,
    and is initially 0. The default initial weights are uniform in ±1/n for n elements of x.
    `weight: W` and `bias: b` take named parameters of these axes instead, which other layers can
    share. `dropout` is the share of elements of y that training drops at random.
    """
    (value,) = arguments
    summed = context.elements(value)[-1]
    bias = "bias" if settings.bias is True else settings.bias or None
    out = context.out(settings.out)
    layer = Affine(
        weight="weight",
        bias=bias,
        out=out,
        init=settings.init,
        bound=1.0 / summed.size,
        given=settings.weight,
    )
    return context.dropout(layer.of(context, value, summed), settings.dropout)


LINEAR = LayerRule(Linear, read_elements, linear)
