"""Finds operations that are not differentiable somewhere within the ranges of a spec."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from compiler.ir import ops
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.passes.analyses.intervals import Interval, negative, total
from compiler.passes.analyses.value_ranges import ValueRanges


@dataclass(frozen=True, slots=True)
class Kink:
    """An operation that is not smooth where a quantity is 0, and the interval of that quantity."""

    node: NodeId
    word: str
    """The operation's name in a spec."""
    distance: Interval


def kinks(program: Program) -> dict[NodeId, Kink]:
    """The kinks of a step, by node.

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
    """The two values that a condition compares; None for other conditions."""
    node = graph[graph.unrepeated(condition)]
    # a comparison of a value with itself tests for NaN
    if not isinstance(node.op, ops.Compare) or node.args[0] == node.args[1]:
        return None
    left, right = node.args
    return left, right


def _distances(graph: Graph, node: Node, ranges: ValueRanges) -> Iterator[tuple[str, Interval]]:
    """The quantities at whose zero the operation has a kink."""
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
