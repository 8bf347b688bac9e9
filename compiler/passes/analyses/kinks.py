"""Finds operations that have no slope, or one that jumps, inside the ranges of a spec."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from compiler.ir import ops
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.passes.analyses.intervals import Interval, negative, total
from compiler.passes.analyses.value_ranges import ValueRanges


@dataclass(frozen=True, slots=True)
class Kink:
    """An operation that bends sharply where a quantity is 0, and what that quantity can be."""

    node: NodeId
    word: str
    """What it is called in a spec."""
    distance: Interval


def kinks(program: Program) -> dict[NodeId, Kink]:
    """The kinks of a step by their nodes.

    Those whose distance follows from no declared range are not among them, nor those that the
    declared ranges do not reach.
    """
    graph, ranges = program.step, ValueRanges(program)
    found: dict[NodeId, Kink] = {}
    for index, node in graph:
        for word, distance in _distances(graph, node, ranges):
            # √ has its kink at the end of where it is defined, all others between two sides
            touches = distance.low <= 0.0 if word == "sqrt" else distance.low < 0.0
            if distance.of and touches and distance.high > 0.0:
                found.setdefault(index, Kink(index, word, distance))
    return found


def compared(graph: Graph, condition: NodeId) -> tuple[NodeId, NodeId] | None:
    """The two values of which a condition says which is larger."""
    node = graph[graph.unrepeated(condition)]
    # a value compared with itself decides nothing by its size
    if not isinstance(node.op, ops.Compare) or node.args[0] == node.args[1]:
        return None
    left, right = node.args
    return left, right


def _distances(graph: Graph, node: Node, ranges: ValueRanges) -> Iterator[tuple[str, Interval]]:
    """The quantities at whose 0 the operation has a kink."""
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
            # two equal branches make no jump, whichever is taken
            if sides is not None and args[1] != args[2]:
                yield "where", _difference(ranges, *sides)
        case _:
            pass


def _difference(ranges: ValueRanges, left: NodeId, right: NodeId) -> Interval:
    return total(ranges.of(left), negative(ranges.of(right)))
