"""Finds kinks within the declared ranges of a spec, and smooths them for optimisers that need
second derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node, with_step
from compiler.ir.nodes import needed
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.ir.types import Axis
from compiler.passes.analyses.intervals import Interval, ValueRanges, negative, total

WIDTH = 1e-3
"""Width of a smoothed kink, relative to the maximum magnitude of the quantity that is 0 there."""

_SINGULAR = frozenset({"log", "pow", "asin", "acos"})


def smooth_kinks(program: Program) -> Program:
    """Replaces operations by a smooth form if the declared ranges include their kinks.

    Let d be the quantity that is 0 at the kink, and w = `WIDTH` times its maximum magnitude in the
    declared ranges (`WIDTH` if unbounded). With |d|ₛ = √(d² + w²):

        abs(d)               |d|ₛ
        sign(d)              d / |d|ₛ
        max(a, b), relu      (a + b + |a − b|ₛ) / 2, min with − |a − b|ₛ
        clip(x, low, high)   min(max(x, low), high), both smooth
        sqrt(d)              d / √|d|ₛ, below 0 too
        where(a > b, y, z)   z + (y − z) (1 + (a − b) / |a − b|ₛ) / 2

    A `where` does not change if exactly one branch contains a singular operation: a division by a
    value that can be 0, log, pow, asin, acos or a root that is not smooth. That branch may be
    infinite or NaN beyond the kink.

    Before: any form. After: other values, by about w near kinks; fuzzy sets sum to 1 up to this
    error.
    """
    graph, found = program.step, kinks(program)
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        made: NodeId | None = None
        # smooth only reachable kinks; all other nodes keep their bits
        if index in found and not (
            isinstance(node.op, ops.Select) and _is_kept(graph, node, found)
        ):
            with builder.at(node.span):
                smooth = _Smooth(builder, node.type.axes, _width(found[index].distance))
                made = _smoothed(smooth, graph, node, copies)
        if made is None:
            made = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
        copies[index] = made
        if node.label is not None:
            builder.name(copies[index], node.label)
    return with_step(program, builder.graph(), copies)


def sharp_kinks(program: Program) -> dict[NodeId, Kink]:
    """The kinks that `smooth_kinks` leaves unchanged, by node."""
    graph, found = program.step, kinks(program)
    return {
        index: kink
        for index, kink in found.items()
        if isinstance(graph[index].op, ops.Select) and _is_kept(graph, graph[index], found)
    }


def _smoothed(
    smooth: _Smooth, graph: Graph, node: Node, copies: Mapping[NodeId, NodeId]
) -> NodeId | None:
    args = [copies[arg] for arg in node.args]
    match node.op:
        case ops.Apply("abs"):
            made = smooth.magnitude(args[0])
        case ops.Apply("sign"):
            made = smooth.sign(args[0])
        case ops.Apply("sqrt"):
            made = smooth.root(args[0])
        case ops.Maximum():
            made = smooth.largest(*args)
        case ops.Minimum():
            made = smooth.least(*args)
        case ops.Clamp():
            made = smooth.least(smooth.largest(args[0], args[1]), args[2])
        case ops.Select():
            sides = compared(graph, node.args[0])
            assert sides is not None
            condition = graph[graph.unrepeated(node.args[0])].op
            assert isinstance(condition, ops.Compare)
            left, right = (copies[side] for side in sides)
            # `left > right` selects the first branch: swap the operands of other relations
            if condition.relation in (ops.Relation.LESS, ops.Relation.LESS_EQUAL):
                left, right = right, left
            made = smooth.chosen(left, right, args[1], args[2])
        case _:
            return None
    b = smooth.builder
    # squares and roots have other units than the operation
    return made if b.type(made) == node.type else b.emit(ops.Reshape(), (made,), node.type)


def _width(distance: Interval) -> float:
    largest = max(abs(distance.low), abs(distance.high))
    # without a range the width is absolute
    return WIDTH * (largest if math.isfinite(largest) else 1.0)


def _is_kept(graph: Graph, node: Node, found: Container[NodeId]) -> bool:
    """True if exactly one branch of the `where` contains an operation that can be infinite; such a
    `where` is not smoothed. `found` are the kinks by node.
    """
    divisors = GraphBuilder(graph).infinite_values
    then, otherwise = (needed(graph, [branch]) for branch in node.args[1:])

    def is_singular(index: NodeId) -> bool:
        made = graph[index]
        match made.op:
            case ops.Divide():
                return not divisors.divides(made.args[1])
            case ops.Apply("sqrt"):
                return index not in found and not divisors.is_never_zero(made.args[0])
            case ops.Apply(function):
                return function in _SINGULAR
            case _:
                return False

    # a singular operation in both branches is used in any case
    return any(
        first != second and is_singular(index)
        for index, (first, second) in enumerate(zip(then, otherwise, strict=True))
    )


@dataclass(frozen=True, slots=True)
class _Smooth:
    """Adds the smooth forms of operations whose value has these axes; `width` is w in the formulas
    of `smooth_kinks`.
    """

    builder: GraphBuilder
    axes: tuple[Axis, ...]
    width: float

    def magnitude(self, x: NodeId) -> NodeId:
        b = self.builder
        # √(d² + w²) is never 0, so its derivatives are finite
        squares = b.add(b.multiply(x, x), self._number(self.width * self.width))
        return b.apply("sqrt", squares)

    def sign(self, x: NodeId) -> NodeId:
        return self.builder.divide(x, self.magnitude(x))

    def root(self, x: NodeId) -> NodeId:
        return self.builder.divide(x, self.builder.apply("sqrt", self.magnitude(x)))

    def largest(self, left: NodeId, right: NodeId) -> NodeId:
        b = self.builder
        apart = self.magnitude(b.subtract(left, right))
        return b.multiply(self._number(0.5), b.add(b.add(left, right), apart))

    def least(self, left: NodeId, right: NodeId) -> NodeId:
        b = self.builder
        apart = self.magnitude(b.subtract(left, right))
        return b.multiply(self._number(0.5), b.subtract(b.add(left, right), apart))

    def chosen(self, left: NodeId, right: NodeId, then: NodeId, otherwise: NodeId) -> NodeId:
        """The smooth form of a `where`: `then` for left > right, else `otherwise`."""
        b = self.builder
        ahead = b.broadcast(b.subtract(left, right), self.axes)
        # (1 + sign) / 2: 0 far on one side, 1 far on the other, 1/2 at the kink
        share = b.multiply(self._number(0.5), b.add(self._number(1.0), self.sign(ahead)))
        return b.add(otherwise, b.multiply(share, b.subtract(then, otherwise)))

    def _number(self, value: float) -> NodeId:
        return self.builder.broadcast(self.builder.constant(value, unit=None), self.axes)


@dataclass(frozen=True, slots=True)
class Kink:
    """An operation that has no derivative where a quantity is 0, and the interval `distance` of
    that quantity.
    """

    node: NodeId
    word: str
    """The operation's name in a spec."""
    distance: Interval


def kinks(program: Program) -> dict[NodeId, Kink]:
    """The kinks of a program's step, by node.

    Kinks are omitted if their quantity is not bounded by declared ranges, or cannot be 0 within
    them.
    """
    graph, ranges = program.step, ValueRanges(program)
    found: dict[NodeId, Kink] = {}
    for index, node in graph:
        for word, distance in _distances(graph, node, ranges):
            # √ has its kink at the end of its domain, all others have values on both sides
            touches = distance.low <= 0.0 if word == "sqrt" else distance.low < 0.0
            if distance.of and touches and distance.high > 0.0:
                found.setdefault(index, Kink(index, word, distance))
    return found


def compared(graph: Graph, condition: NodeId) -> tuple[NodeId, NodeId] | None:
    """The two operands of a condition that is a comparison; None for other conditions, and for the
    comparison of a value with itself.
    """
    node = graph[graph.unrepeated(condition)]
    # a comparison of a value with itself tests for NaN
    if not isinstance(node.op, ops.Compare) or node.args[0] == node.args[1]:
        return None
    left, right = node.args
    return left, right


def _distances(graph: Graph, node: Node, ranges: ValueRanges) -> Iterator[tuple[str, Interval]]:
    """For each quantity at whose zero the operation has a kink: the operation's name in a spec, and
    the interval of the quantity, from the intervals `ranges` of all nodes.
    """
    args = node.args
    match node.op:
        case ops.Apply("abs" | "sign" | "sqrt" as function):
            yield function, ranges.of(args[0])
        case ops.Minimum() | ops.Maximum():
            word = "min" if isinstance(node.op, ops.Minimum) else "max"
            yield word, _difference(ranges, args[0], args[1])
        case ops.Clamp():
            for bound in args[1:]:
                yield "clip", _difference(ranges, args[0], bound)
        case ops.Select():
            sides = compared(graph, args[0])
            # two equal branches have no discontinuity
            if sides is not None and args[1] != args[2]:
                yield "where", _difference(ranges, *sides)
        case _:
            pass


def _difference(ranges: ValueRanges, left: NodeId, right: NodeId) -> Interval:
    return total(ranges.of(left), negative(ranges.of(right)))
