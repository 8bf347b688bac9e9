"""Finds fuzzy sets with compact support, and sums over them in which the terms of inactive sets are
0, so that code can omit these terms.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph, Node, NodeId
from compiler.layers.rules.fuzzy_sets import FuzzySets, between, triangular
from compiler.passes.simplify import folded
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class CompactSets:
    """Degrees of membership of the scalar node `value` along one axis; all except one or two
    neighbouring ones are +0.

    `triangular`: hat functions around `points`. `rectangular`: one more set than `points`, which
    are the bounds between the sets.
    """

    shape: Literal["triangular", "rectangular"]
    value: NodeId
    points: NodeId


def compact_sets(graph: Graph) -> dict[NodeId, CompactSets]:
    """The nodes that are degrees of membership in compact sets, as `layers/rules/fuzzy_sets.py`
    builds them.

    Candidates are recognised by building the formula again and comparing the nodes, so that the
    formula exists only once.
    """
    builder = GraphBuilder(graph)
    again: dict[NodeId, tuple[NodeId, CompactSets]] = {}
    for index, node in graph:
        found = _candidate(graph, node)
        if found is not None:
            # points lie along one axis, as `_compared` checks
            (axis,) = graph[found.points].type.axes
            make = _FORMULAS[found.shape]
            again[index] = (make(FuzzySets(builder, found.value, axis, found.points)), found)
    # both formulas are equal if folding merges them to one node
    _, copies = folded(builder.graph()) if again else (graph, {})
    return {index: found for index, (made, found) in again.items() if copies[made] == copies[index]}


_FORMULAS: dict[str, Callable[[FuzzySets], NodeId]] = {
    "triangular": triangular,
    "rectangular": between,
}


def supports(graph: Graph, sets: dict[NodeId, CompactSets]) -> list[dict[str, NodeId]]:
    """For each node, the axes along which its elements are ±0 wherever compact sets are 0, with the
    node of those sets. `sets` is the result of `compact_sets`.

    This assumes finite values, as ∞ · 0 is not 0.
    """
    found: list[dict[str, NodeId]] = []
    for index, node in graph:
        found.append(
            {node.type.axes[0].name: index} if index in sets else _support(graph, node, found)
        )
    return found


def active_sums(graph: Graph, support: list[dict[str, NodeId]]) -> dict[NodeId, NodeId]:
    """For each sum along the axis of compact sets whose terms are ±0 where the sets are 0, the node
    of those sets. `support` is the result of `supports`.
    """
    found: dict[NodeId, set[NodeId]] = {}
    for index, node in graph:
        if isinstance(node.op, ops.Reduction):
            for arg in node.args:
                if node.op.axis in support[arg]:
                    found.setdefault(index, set()).add(support[arg][node.op.axis])
    # two different sets along one axis are 0 at different places: no term can be omitted
    return {index: next(iter(sets)) for index, sets in found.items() if len(sets) == 1}


def is_positive_zero(graph: Graph, node: NodeId) -> bool:
    """True if the node is the constant +0, possibly repeated by a `Broadcast`."""
    op = graph[graph.unrepeated(node)].op
    # compares bits, since −0 == +0 and adding −0 changes no sign
    return isinstance(op, ops.Constant) and {value.hex() for value in op.values} == {(0.0).hex()}


def _candidate(graph: Graph, node: Node) -> CompactSets | None:
    match node.op:
        # `triangular` ends in a selection by `spread < points`, `between` is a difference of steps
        case ops.Select():
            return _compared(graph, node.args[0], ops.Relation.LESS, "triangular")
        case ops.Subtract():
            lower, upper = (graph[arg] for arg in node.args)
            if isinstance(lower.op, ops.Concat) and isinstance(upper.op, ops.Concat):
                reached = graph[upper.args[0]]
                if isinstance(reached.op, ops.Select):
                    condition = reached.args[0]
                    return _compared(graph, condition, ops.Relation.GREATER_EQUAL, "rectangular")
            return None
        case _:
            return None


def _compared(
    graph: Graph,
    condition: NodeId,
    relation: ops.Relation,
    shape: Literal["triangular", "rectangular"],
) -> CompactSets | None:
    """The candidate for sets of this shape, if the node `condition` compares a scalar with points
    along one axis by `relation`; None otherwise.
    """
    node = graph[condition]
    if node.op != ops.Compare(relation):
        return None
    spread, points = node.args
    if not isinstance(graph[spread].op, ops.Broadcast) or len(graph[points].type.axes) != 1:
        return None
    (value,) = graph[spread].args
    return None if graph[value].type.axes else CompactSets(shape, value, points)


def _support(graph: Graph, node: Node, known: list[dict[str, NodeId]]) -> dict[str, NodeId]:
    operands = [known[arg] for arg in node.args]
    match node.op:
        # 0 times a finite value is 0
        case ops.Multiply():
            return _both(*operands)
        case ops.Broadcast() | ops.Negate():
            return operands[0]
        # `settle_zeros` adds +0, so that a sum of zeros is +0 with or without the omitted terms
        case ops.Add() if is_positive_zero(graph, node.args[1]):
            return operands[0]
        case ops.Reshape():
            # a reshape that keeps the lengths renames axes; any other mixes their elements
            old, new = graph[node.args[0]].type, node.type
            if old.shape != new.shape:
                return {}
            names = dict(zip(old.axis_names, new.axis_names, strict=True))
            return {names[axis]: sets for axis, sets in operands[0].items()}
        # a sum over the axis itself may omit inactive sets and removes the axis
        case ops.Slice(axis) | ops.Sum(axis):
            return {name: sets for name, sets in operands[0].items() if name != axis}
        case ops.Contract(axis):
            return {n: sets for n, sets in _both(*operands).items() if n != axis}
        case _:
            return {}


def _both(first: dict[str, NodeId], second: dict[str, NodeId]) -> dict[str, NodeId]:
    """For a product of two values, the axes along which it is 0 where sets are 0, with the node of
    the sets. `first` and `second` say the same of its factors. Axes along which the factors have
    different sets are omitted.
    """
    either = second | first
    return {
        axis: sets
        for axis, sets in either.items()
        # one factor with sets along an axis makes the product 0 there too
        if first.get(axis, sets) == second.get(axis, sets)
    }
