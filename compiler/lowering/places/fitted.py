"""Broadcasts a value to the axes of the entry that it defines."""

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
    """The value with exactly the axes of `type`; it is repeated along missing axes.

    `node` is the value of the expression in this environment. A value without unit gets that of
    `type`. Axes that the type lacks are reported; then it raises LoweringFailed.
    """
    builder = context.builder(environment)
    if not set(builder.type(node).axes) <= set(type.axes):
        report_surplus(context, what, node, type.axes, expression, environment)
        raise LoweringFailed
    if builder.type(node).unit is None:
        builder.set_unit(node, type.unit)
    return builder.broadcast(node, type.axes)
