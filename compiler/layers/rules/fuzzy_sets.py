"""Adds nodes for the degrees of membership of a value in fuzzy sets with ascending centres cᵢ."""

from __future__ import annotations

import numpy as np

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import NodeId
from compiler.ir.rules import distance_unit
from compiler.ir.scalars import Array
from compiler.ir.types import Axis
from compiler.layers.rules.layer_rule import LayerContext
from compiler.lowering.constants import evaluate
from spec_schema.errors import names
from spec_schema.expressions.tree import Expression
from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import Unit


@dataclass(frozen=True)
class FuzzySets:
    """The value x, the axis of the fuzzy sets, and the node of their centres cᵢ, which are constant
    or learned.

    Values are broadcast by explicit axes, so that a window with as many samples as there are sets
    does not match the axis of the sets.
    """

    builder: GraphBuilder
    value: NodeId
    axis: Axis
    centers: NodeId
    """The node of the centres, along `axis`, in the unit of the value."""

    @property
    def axes(self) -> tuple[Axis, ...]:
        return (self.axis, *self.builder.type(self.value).axes)

    def spread(self, node: NodeId | None = None) -> NodeId:
        """Broadcasts a node with one element per set (None: the value x) to the axis of the sets
        and the axes of x.
        """
        return self.builder.broadcast(self.value if node is None else node, self.axes)

    def numbers(self, values: Array | float) -> NodeId:
        """A dimensionless constant, with one element of `values` per set or one for all, broadcast
        to all axes.
        """
        axes = (self.axis,) if np.ndim(values) else ()
        return self.spread(self.builder.constant(values, axes))

    def distances(self) -> NodeId:
        """The node of x − cᵢ, for each set i."""
        return self.builder.subtract(self.spread(), self.spread(self.centers))

    def slopes(self) -> NodeId:
        """The node of 1 / (cᵢ₊₁ − cᵢ), the derivative of a hat function between neighbouring
        centres; one element fewer than sets.
        """
        builder, last = self.builder, self.axis.size
        above = builder.slice(self.centers, self.axis.name, 1, last)
        below = builder.slice(self.centers, self.axis.name, 0, last - 1)
        return builder.divide(builder.constant(1.0), builder.subtract(above, below))


def triangular(sets: FuzzySets) -> NodeId:
    """The node of the hat functions μᵢ(x) between neighbouring centres cᵢ; they sum to 1.

    For x < cᵢ, μᵢ(x) = max((x − cᵢ₋₁) / (cᵢ − cᵢ₋₁), 0). For x ≥ cᵢ, μᵢ(x) = max((cᵢ₊₁ − x) / (cᵢ₊₁
    − cᵢ), 0). Beyond the outermost centres their functions are constantly 1. The derivative at a
    centre is the right-hand one.
    """
    builder, name, last = sets.builder, sets.axis.name, sets.axis.size
    if last == 1:
        return sets.numbers(1.0)
    slopes = sets.slopes()
    # constant beyond the outermost centres
    flat = builder.constant([0.0], (Axis(name, 1),), builder.type(slopes).unit)
    first, final = (
        builder.slice(sets.centers, name, 0, 1),
        builder.slice(sets.centers, name, last - 1, last),
    )
    before = builder.concat([first, builder.slice(sets.centers, name, 0, last - 1)], name)
    after = builder.concat([builder.slice(sets.centers, name, 1, last), final], name)
    ends = np.arange(last)
    rising = _ramp(sets, before, builder.concat([flat, slopes], name), ends == 0)
    falling = _ramp(
        sets, after, builder.concat([builder.negate(slopes), flat], name), ends == last - 1
    )
    zero = sets.numbers(0.0)
    below = builder.compare(Relation.LESS, sets.spread(), sets.spread(sets.centers))
    return builder.select(below, builder.maximum(rising, zero), builder.maximum(zero, falling))


def _ramp(sets: FuzzySets, origin: NodeId, slope: NodeId, is_flat: Array) -> NodeId:
    """The node of (x − origin) · factor for each set, with the factor in the node `slope`;
    constantly 1 for the sets where `is_flat`.
    """
    builder = sets.builder
    distance = builder.subtract(sets.spread(), sets.spread(origin))
    scaled = builder.multiply(distance, sets.spread(slope))
    return builder.add(scaled, sets.numbers(np.where(is_flat, 1.0, 0.0)))


def beyond(sets: FuzzySets) -> NodeId:
    """The node of the terms that extrapolate the hat functions linearly beyond the outermost
    centres, to be added to `triangular`.

    Below c₀ the first set gains (c₀ − x) / (c₁ − c₀) and the second loses it, and correspondingly
    above the last centre. The degrees still sum to 1.
    """
    builder, name, last = sets.builder, sets.axis.name, sets.axis.size
    slopes, value = sets.slopes(), sets.value
    axes = builder.type(value).axes

    def end(node: NodeId, at: int) -> NodeId:
        return builder.broadcast(builder.element(node, name, at), axes)

    zero = builder.broadcast(builder.constant(0.0), axes)
    # the order of operands gives the right-hand derivative at a knot: a tie uses the first one
    left = builder.minimum(zero, builder.subtract(value, end(sets.centers, 0)))
    right = builder.maximum(builder.subtract(value, end(sets.centers, last - 1)), zero)
    lost, gained = np.zeros(last), np.zeros(last)
    # `below` is negative below c₀: the first set gains, the second loses
    lost[:2] = -1.0, 1.0
    gained[-2:] = -1.0, 1.0
    below = builder.multiply(left, end(slopes, 0))
    above = builder.multiply(right, end(slopes, last - 2))
    return builder.add(
        builder.multiply(sets.spread(below), sets.numbers(lost)),
        builder.multiply(sets.spread(above), sets.numbers(gained)),
    )


def rectangular(sets: FuzzySets) -> NodeId:
    """The node of the degrees that are 1 between the midpoints to the neighbouring centres,
    including the lower midpoint, and 0 elsewhere.
    """
    builder, name, last = sets.builder, sets.axis.name, sets.axis.size
    if last == 1:
        return sets.numbers(1.0)
    above_centers = builder.slice(sets.centers, name, 1, last)
    below_centers = builder.slice(sets.centers, name, 0, last - 1)
    halves = builder.constant(0.5)
    middles = builder.multiply(builder.add(above_centers, below_centers), halves)
    return between(FuzzySets(builder, sets.value, Axis(name, last - 1), middles))


def between(bounds: FuzzySets) -> NodeId:
    """The node with one element per interval between n ascending bounds, n+1 in all: 1 for the
    interval that contains the value, else 0. `bounds.centers` are the bounds.

    An interval includes its lower bound, not its upper one. The values are exact differences of 0
    and 1.
    """
    builder, name = bounds.builder, bounds.axis.name
    edge = (Axis(name, 1), *builder.type(bounds.value).axes)
    above = builder.compare(Relation.GREATER_EQUAL, bounds.spread(), bounds.spread(bounds.centers))
    reached = builder.select(above, bounds.numbers(1.0), bounds.numbers(0.0))
    one = builder.broadcast(builder.constant(1.0), edge)
    zero = builder.broadcast(builder.constant(0.0), edge)
    # interval i: at or above bound i − 1 and below bound i
    lower = builder.concat([one, reached], name)
    upper = builder.concat([reached, zero], name)
    return builder.subtract(lower, upper)


def gaussian(sets: FuzzySets, widths: NodeId) -> NodeId:
    """The node of μᵢ(x) = exp(−((x − cᵢ) / wᵢ)² / 2), not normalised; `widths` is the node of wᵢ,
    one per set.
    """
    builder = sets.builder
    inverse = builder.divide(builder.constant(1.0), widths)
    ratio = builder.multiply(sets.distances(), sets.spread(inverse))
    half = sets.numbers(-0.5)
    return builder.apply("exp", builder.multiply(half, builder.multiply(ratio, ratio)))


def neighbour_widths(centers: Array) -> Array:
    """For each of the ascending centres, half the mean distance to its neighbours, a width of
    `gaussian`: neighbouring sets intersect at about 0.6. A single centre has width 1.
    """
    if len(centers) == 1:
        return np.ones(1)
    gaps = np.diff(centers)
    # an outermost centre has one neighbour, which counts twice
    left = np.concatenate([gaps[:1], gaps])
    right = np.concatenate([gaps, gaps[-1:]])
    return (left + right) / 4


def ascending(context: LayerContext, expression: Expression, layer: str, what: str) -> Array:
    """The values of a constant option, a 1-D array. Reports values that do not ascend or are not
    finite and raises LoweringFailed. `layer` and `what` name the option in the message.
    """
    values = evaluate(context.lowering, expression).values.ravel()
    if np.any(np.diff(values) <= 0) or not np.all(np.isfinite(values)):
        context.refuse(names.unfit_setting(layer, f"the {what} must ascend", expression.span))
    return values


def learned_centers(context: LayerContext, axis: Axis, values: Array, unit: Unit | None) -> NodeId:
    """The node of learned centres along `axis`: c₀ = first, cᵢ₊₁ = cᵢ + gapᵢ with learned gaps > 0,
    so that they stay in order. `values` are the initial centres in `unit`.
    """
    builder = context.builder
    first = context.learned("first", (), values[0], "the lowest centre", unit=unit)
    if len(values) == 1:
        return builder.broadcast(first, (axis,))
    between = context.own_axis("gap", len(values) - 1)
    gaps = context.learned(
        "gaps",
        (between,),
        np.diff(values),
        "from one centre to the next",
        unit=distance_unit(unit),
        low=0.0,
    )
    below = np.tri(len(values), len(values) - 1, -1)
    sums = builder.contract_over(builder.constant(below, (axis, between)), gaps, between.name)
    return builder.add(builder.broadcast(first, (axis,)), sums)
