"""Counts the uses of each element of a value, so that nothing is computed twice."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import assert_never

from compiler.ir import ops
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import Type
from compiler.passes.analyses.compact_sets import CompactSets

MANY = 2
"""Any number of uses above one."""

_NO_SETS: Mapping[NodeId, CompactSets] = {}


def use_counts(
    graph: Graph, roots: Iterable[NodeId], active: Mapping[NodeId, CompactSets] = _NO_SETS
) -> list[int]:
    """For each node 0 (not needed), 1 (each element used at most once) or MANY.

    A value with 1 can be computed at its use; one with MANY must be stored. Uses through a
    broadcast, slice or reshape count for the value behind it. `active` fuzzy sets need only their
    value and points, several times.
    """
    counts = [0] * len(graph)
    for root in roots:
        counts[root] = min(MANY, counts[root] + 1)
    # backwards: all users of a node come after it
    for index in range(len(graph) - 1, -1, -1):
        sets = active.get(index)
        # the value is compared with the points on both sides of each active set
        if sets is not None and counts[index]:
            counts[sets.value] = counts[sets.points] = MANY
        elif counts[index]:
            node = graph[index]
            for arg in node.args:
                uses = _uses(node, graph[arg].type, counts[index])
                counts[arg] = min(MANY, counts[arg] + uses)
    return counts


def only_units_moved(old: Type, new: Type) -> bool:
    """True if a reshape only adds, removes or renames axes of length 1."""
    return [n for n in old.shape if n != 1] == [n for n in new.shape if n != 1]


def _uses(node: Node, operand: Type, demand: int) -> int:
    """The uses of an element of the operand if the node's own elements are used `demand` times."""
    match node.op:
        case ops.Broadcast():
            # each element of the operand is used this many times in the result
            return demand * (node.type.size // operand.size)
        case ops.Slice() | ops.Identity():
            return demand
        case ops.Reshape():
            return demand if only_units_moved(operand, node.type) else MANY
        case ops.Contract(axis):
            # a factor is read once for each element of the result along the axes that it lacks
            return node.type.size * operand.axes[operand.position(axis)].size // operand.size
        case ops.Window():
            return MANY  # written to the buffer, and often to two places of it
        case ops.Elementwise() | ops.Concat() | ops.Sum():
            # computed once each, however often they are used themselves: then they are kept
            return 1
        case ops.Leaf():
            return 0
        case _:
            assert_never(node.op)
