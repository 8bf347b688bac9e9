"""Brings a value to the axes of the place that it is for."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.types import Type, describe_axes
from compiler.lowering.context import Context
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import shapes
from spec_schema.expressions.tree import Expression


def fitted(
    context: Context,
    what: str,
    node: NodeId,
    type: Type,
    expression: Expression,
    builder: GraphBuilder,
) -> NodeId:
    """The value with exactly the axes of the type; a value without some of them is repeated.

    A value whose unit is not known gets the type's.
    """
    found = builder.type(node).axes
    if not set(found) <= set(type.axes):
        wanted, shown = describe_axes(type.axes), describe_axes(found)
        context.findings.report(shapes.wrong_axes(what, wanted, shown, expression.span))
        raise LoweringFailed
    if builder.type(node).unit is None:
        builder.set_unit(node, type.unit)
    return builder.broadcast(node, type.axes)
