"""Splits the graph of a step's derivatives so that they reuse intermediate results of its values.

The line search evaluates the values of a trial point first, and the derivatives only if it accepts
the point. The values function therefore saves its costly intermediate results, such as activations,
and the derivatives function reads them:

    before:  value = W·tanh(a)        derivative = W·(1 − tanh(a)²)·ȧ
    after:   kept = tanh(a)           value = W·kept             derivative = W·(1 − kept²)·ȧ
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from compiler.hessian.step_derivatives import StepDerivatives
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node
from compiler.ir.nodes import needed
from compiler.ir.program import Graph, NodeId

_STRUCTURE = ops.Broadcast | ops.Reshape | ops.Identity | ops.Slice | ops.Concat
"""Operations that only rearrange or copy elements; their results are not worth saving."""
_COSTLY = ops.Apply | ops.Divide | ops.Sum | ops.Contract


@dataclass(frozen=True, slots=True)
class CutGraph:
    """The graph of the derivatives. It reads each saved intermediate result as a signal.

    `kept_signal` names these signals.
    """

    slopes: Graph
    moved: dict[NodeId, NodeId]
    """Maps each copied or saved node of the original graph to its node in `slopes`."""
    kept: tuple[NodeId, ...]
    """The nodes of the original graph whose results the values function saves, ascending."""


def kept_signal(number: int) -> str:
    """Returns the name of the signal through which the derivatives read saved node `number`."""
    return f"kept {number}"


def cut_at_values(found: StepDerivatives, roots: Sequence[NodeId]) -> CutGraph:
    """Builds the graph of the derivatives `roots` that reads costly intermediate values as signals.

    `found` has the joint graph of values and derivatives. Cheap intermediate values are computed
    again.
    """
    graph = found.graph
    of_values = needed(graph, found.values.values())
    saved = tuple(sorted(_kept(graph, roots, of_values)))
    builder = GraphBuilder()
    moved: dict[NodeId, NodeId] = {}
    # operands of saved nodes are not needed here
    live = _needed_beyond(graph, roots, frozenset(saved))
    for index, node in graph:
        if index in saved:
            number = saved.index(index)
            moved[index] = builder.signal(kept_signal(number), 0, 0, node.type)
        elif index in live:
            moved[index] = copy_node(builder, node, tuple(moved[arg] for arg in node.args))
    return CutGraph(builder.graph(), moved, saved)


def _kept(graph: Graph, roots: Iterable[NodeId], of_values: list[bool]) -> set[NodeId]:
    """Returns the nodes to save: the first costly value on each path from a root to the leaves."""
    costly: list[bool] = []
    for _, node in graph:
        # a node is costly, too, if one of its operands is
        costly.append(isinstance(node.op, _COSTLY) or any(costly[arg] for arg in node.args))
    saved: set[NodeId] = set()
    seen: set[NodeId] = set()
    waiting = list(roots)
    while waiting:
        index = waiting.pop()
        if index in seen:
            continue
        seen.add(index)
        node = graph[index]
        # conditions are cheap, and the array of saved values holds no bools
        is_value = of_values[index] and costly[index] and node.type.kind == "real"
        if is_value and not isinstance(node.op, _STRUCTURE):
            saved.add(index)
        else:
            waiting += node.args
    return saved


def _needed_beyond(graph: Graph, roots: Iterable[NodeId], saved: frozenset[NodeId]) -> set[NodeId]:
    """Returns the nodes that the roots depend on, without the operands of saved nodes."""
    live: set[NodeId] = set()
    waiting = list(roots)
    while waiting:
        index = waiting.pop()
        if index not in live:
            live.add(index)
            waiting += () if index in saved else graph[index].args
    return live
