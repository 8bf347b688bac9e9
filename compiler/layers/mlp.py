"""`mlp`: a multilayer perceptron, affine maps with an activation function between them."""

from __future__ import annotations

import math

from compiler.ir.program import NodeId
from compiler.layers.affine import Affine
from compiler.layers.rules.arguments import read_elements
from compiler.layers.rules.layer_rule import Arguments, LayerContext, LayerRule
from spec_schema.fields.leaf import Located
from spec_schema.sections.layer_kinds import Mlp


def mlp(context: LayerContext, settings: Mlp, arguments: Arguments) -> NodeId:
    """h₁ = f(W₁ x + b₁), h₂ = f(W₂ h₁ + b₂), …, y = Wₙ hₙ₋₁ + bₙ, sample by sample.

    x is as in `linear`: its last axis besides the window, or several arguments concatenated.
    `hidden: [16, 16]` are the sizes of h₁, h₂, …; `activation` is f, a function of one argument of
    the language or of the spec, by default tanh. The arrays W and b are called `weight1`, `bias1`,
    …, the last ones for y. A weight has one row for each of its results. Biases start at 0 (none
    with `bias: false`), weights by default uniform in ±√(6 / (inputs + outputs)) (Glorot and Bengio
    2010, equation 16). `dropout` is the share of elements of h₁, h₂, … that training drops at
    random.
    """
    (value,) = arguments
    activation = settings.activation or Located("tanh", settings.place.key)
    summed = context.elements(value)[-1]
    sizes = [context.own_axis(f"hidden{i + 1}", n) for i, n in enumerate(settings.hidden)]
    for number, out in enumerate([*((axis,) for axis in sizes), context.out(settings.out)], 1):
        rows = math.prod(axis.size for axis in out)
        bound = math.sqrt(6.0 / (summed.size + rows))
        bias = f"bias{number}" if settings.bias else None
        layer = Affine(
            weight=f"weight{number}", bias=bias, out=out, init=settings.init, bound=bound
        )
        value = layer.of(context, value, summed)
        if number <= len(sizes):
            value = context.dropout(context.apply(activation, [value]), settings.dropout)
            (summed,) = out
    return value


MLP = LayerRule(Mlp, read_elements, mlp, is_black_box=True)
