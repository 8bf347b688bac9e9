"""Arrays of a layer that are named parameters, which layers and expressions can share."""

from __future__ import annotations

from compiler.ir.program import NodeId
from compiler.ir.types import Axis, describe_axes
from compiler.layers.rules.layer_context import LayerContext
from spec_schema.errors import names, shapes
from spec_schema.fields.located import Located
from spec_schema.sections.values import Parameter


def named_array(context: LayerContext, reference: Located[str], axes: tuple[Axis, ...]) -> NodeId:
    """The parameter as an array with the axes of the cells and `axes`, in this order.

    Dims of the spec must be equal. Windows, list elements and internal axes of the layer have no
    name in the spec, so only their sizes must match.
    """
    lowering, name, place = context.lowering, reference.value, reference.span
    declared = lowering.names.declared(name, place)
    if not isinstance(declared.entry, Parameter):
        problem = f"`{name}` is {declared.kind.value}, not a parameter"
        repair = "name one of `parameters:`"
        context.refuse(names.unfit_setting(f"`{context.name}`", problem, place, repair))
    context.stores.arrays.parameter(name, declared.entry)
    node = context.stores.arrays.read(context.builder, name)
    full = (*context.cells, *axes)
    found = context.builder.type(node).axes
    fits = len(found) == len(full) and all(
        own.size == wanted.size and (own.name == wanted.name or not _is_dim(context, wanted))
        for own, wanted in zip(found, full, strict=True)
    )
    if not fits:
        declared_at = declared.entry.place.key
        asked = (axis if _is_dim(context, axis) else Axis("any", axis.size) for axis in full)
        needs, has = describe_axes(tuple(asked)), describe_axes(found)
        report = shapes.unfit_parameter(context.name, name, needs, has, place, declared_at)
        context.refuse(report)
    return context.builder.reshape(node, full)


def _is_dim(context: LayerContext, axis: Axis) -> bool:
    return axis.name in context.lowering.scope
