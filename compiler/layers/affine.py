"""A learned affine map along one axis of a value, which several layers use."""

from __future__ import annotations

from dataclasses import dataclass

from compiler.ir.program import NodeId
from compiler.ir.types import Axis, describe_axes
from compiler.layers.rules.arguments import named_array
from compiler.layers.rules.layer_rule import LayerContext
from spec_schema.errors import shapes
from spec_schema.fields.leaf import Located
from spec_schema.sections.values import Initializer


@dataclass(frozen=True, kw_only=True)
class Affine:
    """y[o] = Σᵢ W[o, i] · x[i] (+ b[o]), with i one axis of the value x and o the axes `out`. The
    map is the same for every sample and along every other axis of x.
    """

    weight: str
    """Name of W within the layer."""
    bias: str | Located[str] | None
    """Name of b within the layer, or the parameter that is b; None for a map without b."""
    out: tuple[Axis, ...]
    init: Initializer | None
    """Initial weights; by default uniform in ±`bound`."""
    bound: float
    given: Located[str] | None = None
    """The parameter that is W; None if W is an array of the layer."""

    def of(self, context: LayerContext, value: NodeId, summed: Axis) -> NodeId:
        """The node y for the node x = `value`, summed over its axis `summed`. Reports an argument
        that has an axis of `out` besides, and raises LoweringFailed.
        """
        builder = context.builder
        if summed in self.out:  # from a dimension to itself: the inner one gets another name
            inner = context.own_axis(f"{self.weight}.in", summed.size)
            value, summed = builder.rename(value, summed.name, inner.name), inner
        # an axis of both argument and result would be summed and kept at once
        others = [axis for axis in context.elements(value) if axis in self.out]
        if others:
            what, wanted = f"the argument of `{context.name}`", f"without `{others[0].name}`"
            found = describe_axes(context.elements(value))
            place = context.call.arguments[0].span
            context.refuse(shapes.wrong_axes(what, wanted, found, place))
        axes = (*self.out, summed)
        if self.given is not None:
            weight = named_array(context, self.given, axes)
        else:
            start = context.initial(self.weight, self.init, axes, self.bound)
            weight = context.learned(self.weight, axes, start, "one row of weights for each output")
        result = builder.contract_over(weight, value, summed.name)
        match self.bias:
            case None:
                return result
            case Located():
                return builder.add(result, named_array(context, self.bias, self.out))
            case own:
                return builder.add(result, context.learned(own, self.out, 0.0, "offset"))
