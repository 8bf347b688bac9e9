"""Lowers `cross_entropy(logits, target)`, the negative log-probability of the recorded class."""

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
    """−Σᵢ pᵢ log softmax(z)ᵢ = log Σᵢ exp(zᵢ − m) + Σᵢ pᵢ (m − zᵢ), m = max z, Σᵢ pᵢ = 1.

    z are the logits, before any softmax, along their last axis other than the window. The target is
    either p along the same axis, or, without that axis, the index of the class from 0. Returns the
    cost and a mark per sample: NaN for a missing target, the target itself if it is not a class,
    else 0.
    """
    builder = context.builder(environment)
    logits, target = lower_all(context, call.arguments, environment)
    axes = builder.type(logits).axes
    # the same axis as in `softmax`
    classes = next((axis for axis in reversed(axes) if axis.name != WINDOW), None)
    rest = tuple(axis for axis in axes if axis != classes)
    found = builder.type(target).axes
    if classes is None or set(found) not in ({*axes}, {*rest}):
        what = f"the {'first' if classes is None else 'second'} argument of `cross_entropy`"
        expected = f"{describe_axes(axes)} or {describe_axes(rest)}" if classes else "a vector"
        argument = call.arguments[0 if classes is None else 1]
        shown = describe_axes(axes if classes is None else found)
        context.findings.report(shapes.wrong_axes(what, expected, shown, argument.span))
        raise LoweringFailed
    shares, missing = _shares(builder, target, axes, classes)
    # all exponents are ≤ 0, so none overflows; one is 0, so the logarithm's argument is ≥ 1
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
    """p with the axes of the logits, 0 where it is missing; and the mark of samples without
    class.
    """
    zero = builder.constant(0.0)
    missing = builder.multiply(zero, target)  # NaN stays NaN
    if classes in builder.type(target).axes:
        there = builder.compare(Relation.LESS_EQUAL, target, target)  # false for NaN
        # NaN · 0 would be NaN in the sum: only `missing` excludes samples
        known = builder.select(there, target, zero)
        return builder.broadcast(known, axes), builder.sum(missing, classes.name)
    numbers = builder.constant(np.arange(classes.size), (classes,))
    repeated = builder.broadcast(target, (classes, *builder.type(target).axes))
    away = builder.apply("abs", builder.subtract(repeated, numbers))
    # recorded classes are floats; a NaN is near no class, so all shares are 0
    near = builder.compare(Relation.LESS, away, builder.constant(0.5))
    shares = builder.select(near, builder.constant(1.0), zero)
    # an index without class has no share: the mark makes checks of the data find it
    nowhere = builder.compare(
        Relation.LESS, builder.sum(shares, classes.name), builder.constant(0.5)
    )
    return builder.broadcast(shares, axes), builder.select(nowhere, target, missing)
