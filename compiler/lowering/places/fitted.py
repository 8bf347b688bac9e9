"""Brings a value to the axes of the place that it is for."""

from __future__ import annotations

from compiler.ir.program import NodeId
from compiler.ir.types import Type
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.places.surplus_axes import report_surplus
from spec_schema.expressions.tree import Expression


def fitted(
    context: Context,
    what: str,
    node: NodeId,
    type: Type,
    expression: Expression,
    environment: Environment,
) -> NodeId:
    """The value with exactly the axes of the type; a value without some of them is repeated.

    `node` is the value of the expression in this environment. A value whose unit is not known gets
    the type's.
    """
    builder = context.builder(environment)
    if not set(builder.type(node).axes) <= set(type.axes):
        report_surplus(context, what, node, type.axes, expression, environment)
        raise LoweringFailed
    if builder.type(node).unit is None:
        builder.set_unit(node, type.unit)
    return builder.broadcast(node, type.axes)
