"""Cuts the derivatives of a step where its values end, so that slopes take up what they left.

The values of a trial point are computed before anybody knows whether the point is taken. What they
computed on the way, such as activations, is kept for the slopes at the same point:

    before:  value = W·tanh(a)        slope = W·(1 − tanh(a)²)·ȧ
    after:   kept = tanh(a)           value = W·kept             slope = W·(1 − kept²)·ȧ
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from compiler.hessian.step_derivatives import StepDerivatives
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node
from compiler.ir.liveness import needed
from compiler.ir.program import Graph, NodeId

_STRUCTURE = ops.Broadcast | ops.Reshape | ops.Identity | ops.Slice | ops.Concat
"""Operations that only say where numbers stand."""
_COSTLY = ops.Apply | ops.Divide | ops.Sum | ops.Contract


@dataclass(frozen=True, slots=True)
class CutGraph:
    """The graph of the slopes, which reads `kept_signal` in place of nodes of the values."""

    slopes: Graph
    moved: dict[NodeId, NodeId]
    """Where the roots of the slopes are in it."""
    kept: tuple[NodeId, ...]
    """The nodes that the values leave, in the graph that was cut."""


def kept_signal(number: int) -> str:
    """The signal by which the slopes read a kept node."""
    return f"kept {number}"


def cut_at_values(found: StepDerivatives, roots: Sequence[NodeId]) -> CutGraph:
    """Keeps what the slopes need of the values and what takes more than a few operations.

    `roots` are the slopes that are wanted.
    """
    graph = found.graph
    of_values = needed(graph, found.values.values())
    kept = tuple(sorted(_kept(graph, roots, of_values)))
    builder = GraphBuilder()
    moved: dict[NodeId, NodeId] = {}
    # beyond what is kept nothing of the values is needed
    live = _needed_beyond(graph, roots, frozenset(kept))
    for index, node in graph:
        if index in kept:
            number = kept.index(index)
            moved[index] = builder.signal(kept_signal(number), 0, 0, node.type)
        elif index in live:
            moved[index] = copy_node(builder, node, tuple(moved[arg] for arg in node.args))
    return CutGraph(builder.graph(), moved, kept)


def _kept(graph: Graph, roots: Iterable[NodeId], of_values: list[bool]) -> set[NodeId]:
    costly: list[bool] = []
    for _, node in graph:
        # costly is also what costly values enter
        costly.append(isinstance(node.op, _COSTLY) or any(costly[arg] for arg in node.args))
    kept: set[NodeId] = set()
    seen: set[NodeId] = set()
    waiting = list(roots)
    while waiting:
        index = waiting.pop()
        if index in seen:
            continue
        seen.add(index)
        node = graph[index]
        # conditions are cheap, and bools have no place among numbers
        is_value = of_values[index] and costly[index] and node.type.kind == "real"
        if is_value and not isinstance(node.op, _STRUCTURE):
            kept.add(index)
        else:
            waiting += node.args
    return kept


def _needed_beyond(graph: Graph, roots: Iterable[NodeId], kept: frozenset[NodeId]) -> set[NodeId]:
    found: set[NodeId] = set()
    waiting = list(roots)
    while waiting:
        index = waiting.pop()
        if index not in found:
            found.add(index)
            waiting += () if index in kept else graph[index].args
    return found
