"""`normalize`: a value in standard units, and back by `NAME.inverse(…)`."""

from __future__ import annotations

import numpy as np

from compiler.layers.arguments import read_value
from compiler.layers.layer_context import LayerContext
from compiler.layers.layer_rule import Arguments, LayerRule
from compiler.program import NodeId
from compiler.types import Axis, describe_axes
from spec_schema.errors import names, shapes
from spec_schema.expression import Expression
from spec_schema.layers import Normalize
from spec_schema.units import Unit


def normalize(context: LayerContext, settings: Normalize, arguments: Arguments) -> NodeId:
    """y = (x − mean) / std, dimensionless; `mean` and `std` are numbers in the unit of x.

    A list has one number for each element of the last axis of x besides the window. Nothing is
    learned. `NAME.inverse(y)` is y · std + mean, in the layer's `unit:` where it is given.
    """
    (value,) = arguments
    builder = context.builder
    unit = builder.type(value).unit
    mean, std = _numbers(context, settings, value, unit)
    return builder.divide(builder.subtract(value, mean), std)


def _inverse(context: LayerContext, settings: Normalize, arguments: Arguments) -> NodeId:
    (value,) = arguments
    builder = context.builder
    unit = settings.unit.value if settings.unit else None
    mean, std = _numbers(context, settings, value, unit)
    return builder.add(builder.multiply(value, std), mean)


def _numbers(
    context: LayerContext, settings: Normalize, value: NodeId, unit: Unit | None
) -> tuple[NodeId, NodeId]:
    """Mean and standard deviation with the axes of the value."""
    std = context.model.arrays.evaluate(settings.std).values
    if np.any(std <= 0):
        context.refuse(names.unfit_setting("normalize", "`std` must be above 0", settings.std.span))
    mean = _constant(context, settings.mean, value, unit)
    return mean, _constant(context, settings.std, value, unit)


def _constant(
    context: LayerContext, expression: Expression, value: NodeId, unit: Unit | None
) -> NodeId:
    builder = context.builder
    found = context.model.arrays.evaluate(expression)
    axes: tuple[Axis, ...] = ()
    if found.values.ndim:
        axes = context.elements(value)[-1:]
        if found.values.shape != tuple(axis.size for axis in axes):
            wanted = describe_axes(axes) if axes else "one number"
            what = f"an option of `{context.name}`"
            shown = describe_axes(found.axes)
            context.refuse(shapes.wrong_axes(what, wanted, shown, expression.span))
    number = builder.constant(found.values, axes, unit)
    return builder.broadcast(number, builder.type(value).axes)


NORMALIZE = LayerRule(Normalize, read_value, normalize, {"inverse": _inverse})
