"""Finds fuzzy sets of which few are not 0 at once, and what is 0 where they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph, Node, NodeId
from compiler.layers.rules.fuzzy_sets import FuzzySets, between, triangular
from compiler.passes.simplify.fold_constants import folded
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class CompactSets:
    """Degrees of membership of a scalar along an axis; all but one or two neighbours are +0.

    `triangular`: hat functions around `points`; `rectangular`: one more set than `points`, which
    are the bounds between them.
    """

    shape: Literal["triangular", "rectangular"]
    value: NodeId
    points: NodeId


def compact_sets(graph: Graph) -> dict[NodeId, CompactSets]:
    """The values that are degrees of membership in compact sets, as `fuzzy_sets` writes them.

    What looks like such sets is written again and compared, so that no second description of their
    formula exists.
    """
    builder = GraphBuilder(graph)
    again: dict[NodeId, tuple[NodeId, CompactSets]] = {}
    for index, node in graph:
        found = _candidate(graph, node)
        if found is not None:
            # points of sets lie along one axis, as `_compared` has asked for
            (axis,) = graph[found.points].type.axes
            make = _FORMULAS[found.shape]
            again[index] = (make(FuzzySets(builder, found.value, axis, found.points)), found)
    # the formula written here and the one of the program are equal where folding gives one node
    _, copies = folded(builder.graph()) if again else (graph, {})
    return {index: found for index, (made, found) in again.items() if copies[made] == copies[index]}


_FORMULAS: dict[str, Callable[[FuzzySets], NodeId]] = {
    "triangular": triangular,
    "rectangular": between,
}


def supports(graph: Graph, sets: dict[NodeId, CompactSets]) -> list[dict[str, NodeId]]:
    """For each node: axes along which it is ±0 wherever compact sets are 0, and those sets.

    That holds for finite numbers; ∞ · 0 is not 0.
    """
    found: list[dict[str, NodeId]] = []
    for index, node in graph:
        found.append(
            {node.type.axes[0].name: index} if index in sets else _support(graph, node, found)
        )
    return found


def active_sums(graph: Graph, support: list[dict[str, NodeId]]) -> dict[NodeId, NodeId]:
    """Sums along the axis of compact sets whose terms are ±0 where the sets are, and the sets."""
    found: dict[NodeId, set[NodeId]] = {}
    for index, node in graph:
        if isinstance(node.op, ops.Reduction):
            for arg in node.args:
                if node.op.axis in support[arg]:
                    found.setdefault(index, set()).add(support[arg][node.op.axis])
    # two different sets along one axis are 0 at different places: no element may be left out
    return {index: next(iter(sets)) for index, sets in found.items() if len(sets) == 1}


def is_positive_zero(graph: Graph, node: NodeId) -> bool:
    """Whether a value is the number +0, however often repeated."""
    op = graph[graph.unrepeated(node)].op
    # by its bits: −0 == +0, and adding −0 changes no sign
    return isinstance(op, ops.Constant) and {value.hex() for value in op.values} == {(0.0).hex()}


def _candidate(graph: Graph, node: Node) -> CompactSets | None:
    match node.op:
        # `triangular` ends in a choice by `spread < points`, `between` is a difference of two steps
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
    """Sets of the scalar that is compared with points along an axis."""
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
        # 0 times a finite number is 0, whichever factor is
        case ops.Multiply():
            return _both(*operands)
        case ops.Broadcast() | ops.Negate():
            return operands[0]
        # −0 + 0 is +0: `settle_zeros` adds it, so that what is left out has the sign of what is
        # there
        case ops.Add() if is_positive_zero(graph, node.args[1]):
            return operands[0]
        case ops.Reshape():
            # a reshape that keeps the lengths only renames axes; another one mixes their elements
            old, new = graph[node.args[0]].type, node.type
            if old.shape != new.shape:
                return {}
            names = dict(zip(old.axis_names, new.axis_names, strict=True))
            return {names[axis]: sets for axis, sets in operands[0].items()}
        # sums over the axis itself are where sets may be left out; behind them the axis is gone
        case ops.Slice(axis) | ops.Sum(axis):
            return {name: sets for name, sets in operands[0].items() if name != axis}
        case ops.Contract(axis):
            return {n: sets for n, sets in _both(*operands).items() if n != axis}
        case _:
            return {}


def _both(first: dict[str, NodeId], second: dict[str, NodeId]) -> dict[str, NodeId]:
    """The sets of a product; none of an axis along which two different sets meet."""
    either = second | first
    return {
        axis: sets
        for axis, sets in either.items()
        # an axis that only one factor has sets along is 0 there too
        if first.get(axis, sets) == second.get(axis, sets)
    }
