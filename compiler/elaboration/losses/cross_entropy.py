"""Lowers `cross_entropy(logits, target)`: how improbable the recorded class is."""

from __future__ import annotations

import numpy as np

from compiler.builtins.matrices import largest_along
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import NodeId
from compiler.ir.types import WINDOW, Axis, describe_axes
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment
from compiler.lowering.expressions import lower_all
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import shapes
from spec_schema.expressions.tree import Call


def lower_cross_entropy(
    context: Context, call: Call, environment: Environment
) -> tuple[NodeId, NodeId]:
    """−Σᵢ pᵢ log softmax(z)ᵢ = log Σᵢ exp(zᵢ − m) + Σᵢ pᵢ (m − zᵢ), m the largest z, Σᵢ pᵢ = 1.

    z are logits, before any softmax, along their last axis besides the window. The target is p
    along the same axis, or without it the number of the class, counted from 0. Returns the cost
    and what is NaN where the target is missing, a number that is no class where it is one, else 0.
    """
    builder = context.builder(environment)
    logits, target = lower_all(context, call.arguments, environment)
    axes = builder.type(logits).axes
    # the axis that `softmax` takes too, so that both mean the same logits
    classes = next((axis for axis in reversed(axes) if axis.name != WINDOW), None)
    rest = tuple(axis for axis in axes if axis != classes)
    found = builder.type(target).axes
    if classes is None or set(found) not in ({*axes}, {*rest}):
        what = f"the {'first' if classes is None else 'second'} argument of `cross_entropy`"
        wanted = f"{describe_axes(axes)} or {describe_axes(rest)}" if classes else "a vector"
        argument = call.arguments[0 if classes is None else 1]
        shown = describe_axes(axes if classes is None else found)
        context.findings.report(shapes.wrong_axes(what, wanted, shown, argument.span))
        raise LoweringFailed
    shares, missing = _shares(builder, target, axes, classes)
    # no exponent is above 0, so none overflows; one is 0, so the sum is at least 1 and has a
    # logarithm
    largest = largest_along(builder, logits, classes)
    below = builder.subtract(logits, largest)
    total = builder.sum(builder.apply("exp", below), classes.name)
    cost = builder.subtract(
        builder.apply("log", total), builder.sum(builder.multiply(shares, below), classes.name)
    )
    return cost, builder.broadcast(missing, builder.type(cost).axes)


def _shares(
    builder: GraphBuilder, target: NodeId, axes: tuple[Axis, ...], classes: Axis
) -> tuple[NodeId, NodeId]:
    """p with the axes of the logits, 0 where it is missing; and the mark of what is no class."""
    zero = builder.constant(0.0)
    missing = builder.multiply(zero, target)  # NaN stays NaN
    if classes in builder.type(target).axes:
        there = builder.compare(Relation.LESS_EQUAL, target, target)  # no relation holds for NaN
        # NaN · 0 would be NaN in the sum: `missing` alone tells what is not scored
        known = builder.select(there, target, zero)
        return builder.broadcast(known, axes), builder.sum(missing, classes.name)
    numbers = builder.constant(np.arange(classes.size), (classes,))
    repeated = builder.broadcast(target, (classes, *builder.type(target).axes))
    away = builder.apply("abs", builder.subtract(repeated, numbers))
    # recorded classes are real numbers; NaN is near none of them, and all shares are 0
    near = builder.compare(Relation.LESS, away, builder.constant(0.5))
    shares = builder.select(near, builder.constant(1.0), zero)
    # what is no class would have no share at all, and lead training astray: data are looked at
    nowhere = builder.compare(
        Relation.LESS, builder.sum(shares, classes.name), builder.constant(0.5)
    )
    return builder.broadcast(shares, axes), builder.select(nowhere, target, missing)
