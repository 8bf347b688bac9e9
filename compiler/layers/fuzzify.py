"""`fuzzify`: how much a scalar belongs to each of several fuzzy sets with ascending centres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compiler.builder import GraphBuilder
from compiler.ops import Relation
from compiler.program import NodeId
from compiler.scalar_functions import Array
from compiler.types import Axis


@dataclass(frozen=True)
class FuzzySets:
    """A value spread along the axis of the sets, and numbers of the sets spread likewise.

    Axes are fixed before anything is computed: a window as long as there are sets must not be taken
    for the axis of the sets.
    """

    builder: GraphBuilder
    value: NodeId
    axis: Axis

    @property
    def axes(self) -> tuple[Axis, ...]:
        return (self.axis, *self.builder.type(self.value).axes)

    def spread(self) -> NodeId:
        """The value, the same for every set."""
        return self.builder.broadcast(self.value, self.axes)

    def numbers(self, values: Array, power: int = 0) -> NodeId:
        """One number a set, in the value's unit to some power."""
        unit = self.builder.type(self.value).unit
        unit = None if unit is None else unit.power(power)
        return self.builder.broadcast(self.builder.constant(values, (self.axis,), unit), self.axes)


def triangular(builder: GraphBuilder, value: NodeId, axis: Axis, centers: Array) -> NodeId:
    """Hat functions between neighbouring centres, 1 beyond the outermost ones; they sum to 1.

    μᵢ(x) = max((x − cᵢ₋₁) / (cᵢ − cᵢ₋₁), 0) for x < cᵢ, and from cᵢ on
    max((cᵢ₊₁ − x) / (cᵢ₊₁ − cᵢ), 0); the outermost slopes are 0 and their offset 1. Written so, the
    slope on a knot is the right-hand one.
    """
    sets = FuzzySets(builder, value, axis)
    inverse = 1.0 / np.diff(centers)
    before = np.concatenate([centers[:1], centers[:-1]])
    after = np.concatenate([centers[1:], centers[-1:]])
    rising = _ramp(sets, before, np.concatenate([[0.0], inverse]))
    falling = _ramp(sets, after, np.concatenate([-inverse, [0.0]]))
    zero = builder.broadcast(builder.constant(0.0), sets.axes)
    below = builder.compare(Relation.LESS, sets.spread(), sets.numbers(centers, 1))
    return builder.select(below, builder.maximum(rising, zero), builder.maximum(zero, falling))


def _ramp(sets: FuzzySets, origin: Array, slope: Array) -> NodeId:
    """(x − origin) · slope, and 1 for the set whose slope is 0."""
    builder = sets.builder
    distance = builder.subtract(sets.spread(), sets.numbers(origin, 1))
    scaled = builder.multiply(distance, sets.numbers(slope, -1))
    offset = builder.constant(np.where(slope == 0, 1.0, 0.0), (sets.axis,))
    return builder.add(scaled, builder.broadcast(offset, sets.axes))


def rectangular(builder: GraphBuilder, value: NodeId, axis: Axis, centers: Array) -> NodeId:
    """1 between the bounds half-way to the neighbouring centres, the lower one inclusive."""
    one = builder.constant(1.0)
    edge = (Axis(axis.name, 1), *builder.type(value).axes)
    if len(centers) == 1:
        return builder.broadcast(one, edge)
    inner = FuzzySets(builder, value, Axis(axis.name, len(centers) - 1))
    middles = inner.numbers((centers[1:] + centers[:-1]) / 2, 1)
    ones = builder.broadcast(one, inner.axes)
    zeros = builder.broadcast(builder.constant(0.0), inner.axes)
    above = builder.compare(Relation.GREATER_EQUAL, inner.spread(), middles)
    reached = builder.select(above, ones, zeros)
    # The lower bound is reached, the upper one is not: exact differences of 0 and 1.
    lower = builder.concat([builder.broadcast(one, edge), reached], axis.name)
    upper = builder.concat([reached, builder.broadcast(builder.constant(0.0), edge)], axis.name)
    return builder.subtract(lower, upper)


def gaussian(
    builder: GraphBuilder, value: NodeId, axis: Axis, centers: Array, widths: Array
) -> NodeId:
    """μᵢ(x) = exp(−((x − cᵢ) / widthᵢ)² / 2), not normalised."""
    sets = FuzzySets(builder, value, axis)
    distance = builder.subtract(sets.spread(), sets.numbers(centers, 1))
    ratio = builder.multiply(distance, sets.numbers(1.0 / widths, -1))
    half = builder.broadcast(builder.constant(-0.5), sets.axes)
    return builder.apply("exp", builder.multiply(half, builder.multiply(ratio, ratio)))
