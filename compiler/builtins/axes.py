"""Lowers builtins that work along axes: sum, mean, softmax, outer, eye and smooth_sign (R3). Each
function returns the node of a call, and raises LoweringFailed after reporting a mistake.
"""

from __future__ import annotations

import numpy as np

from compiler.builtins.call_options import option
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.types import WINDOW, Axis, describe_axes, in_order
from compiler.lowering.context import Context, LoweringFailed
from compiler.lowering.environment import Environment
from compiler.lowering.expressions import (
    aligning,
    lower,
    lower_all,
    lower_operands,
    warn_of_twin_axes,
)
from spec_schema.errors import names, shapes, time
from spec_schema.expressions.tree import Call, ListLiteral, Name


def lower_sum(context: Context, call: Call, environment: Environment) -> NodeId:
    """`sum(x)` over all axes, or over those of `over=`. Raises LoweringFailed after reporting a
    mistake, such as an unknown axis.
    """
    builder = context.builder(environment)
    node = lower(context, call.arguments[0], environment)
    axes = builder.type(node).axes
    return reduce_axes(builder, node, _reduced_axes(context, "sum", call, environment, axes))


def lower_mean(context: Context, call: Call, environment: Environment) -> NodeId:
    """`mean(x)` over all axes, or over those of `over=`. Raises LoweringFailed after reporting a
    mistake, such as an unknown axis.
    """
    builder = context.builder(environment)
    node = lower(context, call.arguments[0], environment)
    axes = builder.type(node).axes
    removed = _reduced_axes(context, "mean", call, environment, axes)
    count = float(np.prod([axis.size for axis in axes if axis.name in removed]))
    return builder.divide(reduce_axes(builder, node, removed), builder.constant(count))


def _reduced_axes(
    context: Context, name: str, call: Call, environment: Environment, axes: tuple[Axis, ...]
) -> list[str]:
    """Names of the axes that `sum(x, over=…)` removes; all of `axes` without `over`. Reports an
    axis that x lacks and raises LoweringFailed. `name` is the function's name in the message.
    """
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
    """Sums over the axes named in `removed`, the last one first, so that neighbours in memory are
    added first.
    """
    for axis in reversed(builder.type(node).axes):
        if axis.name in removed:
            node = builder.sum(node, axis.name)
    return node


def lower_softmax(context: Context, call: Call, environment: Environment) -> NodeId:
    """`softmax(x)`: exp(xᵢ − m) / Σⱼ exp(xⱼ − m) with m = max x, so that no exponential overflows.

    The axis is the one that `over=` names, otherwise the last axis other than the window. Raises
    LoweringFailed after reporting that there is none.
    """
    builder = context.builder(environment)
    argument = call.arguments[0]
    node = lower(context, argument, environment)
    axis = _softmax_axis(context, call, builder.type(node).axes)
    largest = largest_along(builder, node, axis)
    raised = builder.apply("exp", builder.subtract(node, largest))
    total = builder.broadcast(builder.sum(raised, axis.name), builder.type(raised).axes)
    return builder.divide(raised, total)


def lower_outer(context: Context, call: Call, environment: Environment) -> NodeId:
    """`outer(a, b)`: aᵢ · bⱼ for all i and j. Reports a common axis of a and b and raises
    LoweringFailed.
    """
    builder = context.builder(environment)
    left, right = lower_all(context, call.arguments, environment)
    left_axes, right_axes = builder.type(left).axes, builder.type(right).axes
    shared = {axis.name for axis in left_axes} & {axis.name for axis in right_axes}
    if shared:
        wanted = "without the axes of the first"
        found, place = describe_axes(right_axes), call.arguments[1].span
        what = "the second argument of `outer`"
        context.findings.report(shapes.wrong_axes(what, wanted, found, place))
        raise LoweringFailed
    axes = in_order((*left_axes, *right_axes))
    return builder.multiply(builder.broadcast(left, axes), builder.broadcast(right, axes))


def lower_smooth_sign(context: Context, call: Call, environment: Environment) -> NodeId:
    """`smooth_sign(x, width)`: tanh(x / width), or tanh(x) without a width."""
    builder = context.builder(environment)
    nodes = lower_operands(context, call.arguments, environment)
    operands = zip(call.arguments, nodes, strict=True)
    warn_of_twin_axes(context, builder, "smooth_sign", call, operands)
    with aligning(context, "smooth_sign", call, call.arguments[0], call.arguments[-1]):
        return builder.apply("tanh", builder.divide(*nodes) if len(nodes) == 2 else nodes[0])


def lower_eye(context: Context, call: Call, environment: Environment) -> NodeId:
    """`eye(a, b)`: the identity matrix over two dims of equal length. Reports other arguments and
    raises LoweringFailed.
    """
    axes: list[Axis] = []
    for argument in call.arguments:
        if not isinstance(argument, Name):
            context.findings.report(shapes.wrong_axes(_EYE, _DIM, "an expression", argument.span))
            raise LoweringFailed
        axes.append(context.dimension(argument.name, argument.span))
    if len(axes) < 2:
        problem = "is a matrix and needs two dims: `eye(a, b)`"
        context.findings.report(names.unfit_constant("`eye`", problem, call.span))
        raise LoweringFailed
    if axes[0].name == axes[1].name or axes[0].size != axes[1].size:
        found = f"`{axes[0].name}` of {axes[0].size} and `{axes[1].name}` of {axes[1].size}"
        wanted = "two dims of one length"
        context.findings.report(shapes.wrong_axes("`eye`", wanted, found, call.span))
        raise LoweringFailed
    return context.builder(environment).constant(np.eye(axes[0].size), tuple(axes))


_EYE, _DIM = "an argument of `eye`", "a name of `dims:`"


def _softmax_axis(context: Context, call: Call, axes: tuple[Axis, ...]) -> Axis:
    over = option(call, "over")
    elements = [axis for axis in axes if axis.name != WINDOW]
    if over is None and elements:
        return elements[-1]
    if over is None:
        place = call.arguments[0].span
        found = describe_axes(axes)
        report = shapes.wrong_axes("the argument of `softmax`", "a vector", found, place)
        context.findings.report(report)
        raise LoweringFailed
    label = over.name if isinstance(over, Name) else "?"
    named = next((axis for axis in axes if axis.name == label), None)
    if named is None:
        context.findings.report(
            shapes.no_such_axis("softmax", label, describe_axes(axes), over.span)
        )
        raise LoweringFailed
    return named


def largest_along(builder: GraphBuilder, node: NodeId, axis: Axis) -> NodeId:
    """The node of the maximum along an axis, repeated along it, from log₂ n pairwise maxima of
    halves.
    """
    axes, size, found = builder.type(node).axes, axis.size, node
    # log₂ n operations instead of n
    while size > 1:
        half = size // 2
        first = builder.slice(found, axis.name, 0, half)
        second = builder.slice(found, axis.name, half, 2 * half)
        pairs = builder.maximum(first, second)
        if size % 2:
            rest = builder.slice(found, axis.name, size - 1, size)
            pairs = builder.concat([pairs, rest], axis.name)
        found, size = pairs, half + size % 2
    return builder.broadcast(builder.element(found, axis.name, 0), axes)
