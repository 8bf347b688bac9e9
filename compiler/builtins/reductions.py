"""Lowers sums and means over all axes of a value, or over named ones (R3)."""

from __future__ import annotations

import numpy as np

from compiler.builtins.call_options import option
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.types import Axis, describe_axes
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import shapes, time
from spec_schema.expressions.tree import Call, ListLiteral, Name


def lower_sum(context: Context, call: Call, environment: Environment) -> NodeId:
    """`sum(x)` over all axes, or over those of `over=`."""
    builder = context.builder(environment)
    node = lower(context, call.arguments[0], environment)
    axes = builder.type(node).axes
    return reduce_axes(builder, node, _reduced_axes(context, "sum", call, environment, axes))


def lower_mean(context: Context, call: Call, environment: Environment) -> NodeId:
    """`mean(x)` over all axes, or over those of `over=`."""
    builder = context.builder(environment)
    node = lower(context, call.arguments[0], environment)
    axes = builder.type(node).axes
    removed = _reduced_axes(context, "mean", call, environment, axes)
    count = float(np.prod([axis.size for axis in axes if axis.name in removed]))
    return builder.divide(reduce_axes(builder, node, removed), builder.constant(count))


def _reduced_axes(
    context: Context, name: str, call: Call, environment: Environment, axes: tuple[Axis, ...]
) -> list[str]:
    """Names of the axes that `sum(x, over=…)` removes; all of them without `over`."""
    over = option(call, "over")
    if over is None:
        if environment.window is not None:
            context.findings.report(time.unkept_past("a reduction", call.span))
            raise LoweringFailed
        return [axis.name for axis in axes]
    chosen = over.elements if isinstance(over, ListLiteral) else (over,)
    found: list[str] = []
    for item in chosen:
        label = item.name if isinstance(item, Name) else ""
        if label not in {axis.name for axis in axes} or not label:
            context.findings.report(
                shapes.no_such_axis(name, label or "?", describe_axes(axes), item.span)
            )
            raise LoweringFailed
        found.append(label)
    return found


def reduce_axes(builder: GraphBuilder, node: NodeId, removed: list[str]) -> NodeId:
    """Sums over several axes, the last one first: neighbours in memory are added first."""
    for axis in reversed(builder.type(node).axes):
        if axis.name in removed:
            node = builder.sum(node, axis.name)
    return node
