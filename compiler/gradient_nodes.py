"""Gradients of values of a graph that is still being built, added to it as core operations."""

from __future__ import annotations

from collections.abc import Sequence

from compiler.builder import GraphBuilder
from compiler.differentiate import gradients
from compiler.graph_copy import copy_node
from compiler.ops import Reshape
from compiler.passes.guard_untaken import guarded
from compiler.program import NodeId
from compiler.unit_rules import quotient_unit


def gradient_nodes(
    builder: GraphBuilder, value: NodeId, wanted: Sequence[NodeId]
) -> list[NodeId | None]:
    """Σ ∂value/∂w over all elements of the value, for each wanted node w; None where there is none.

    It has the axes of w and the unit of value / w. Only what the value is made of is looked at, its
    untaken branches are guarded first, and the nodes of it that are in the graph are used again.
    """
    graph, copies = guarded(builder.graph(), [value])
    draft = GraphBuilder(graph)
    one = draft.broadcast(draft.constant(1.0), builder.type(value).axes)
    present = [node for node in wanted if node in copies]
    found = gradients(draft, {copies[value]: one}, [copies[node] for node in present])
    slopes = dict(zip(present, found, strict=True))
    copied = _Copied(builder, draft, len(graph))
    results: list[NodeId | None] = []
    for node in wanted:
        slope = slopes.get(node)
        results.append(None if slope is None else copied.result(slope, value, node))
    return results


class _Copied:
    """The nodes of a draft, copied into the graph where they are needed."""

    def __init__(self, builder: GraphBuilder, draft: GraphBuilder, given: int) -> None:
        self._builder = builder
        self._draft = draft
        self._given = given
        self._copies: dict[NodeId, NodeId] = {}

    def result(self, slope: NodeId, value: NodeId, node: NodeId) -> NodeId:
        builder = self._builder
        self._copy(slope)
        copied = self._copies[slope]
        unit = quotient_unit(builder.type(value).unit, builder.type(node).unit)
        type = builder.type(copied)
        if unit is None or type.unit == unit:
            return copied
        return builder.emit(Reshape(), (copied,), type.with_unit(unit))

    def _copy(self, wanted: NodeId) -> None:
        waiting = [wanted]
        while waiting:
            index = waiting[-1]
            node = self._draft.node(index)
            missing = [arg for arg in node.args if arg not in self._copies]
            if index in self._copies or not missing:
                waiting.pop()
            if index not in self._copies and not missing:
                args = tuple(self._copies[arg] for arg in node.args)
                self._copies[index] = copy_node(self._builder, node, args)
            waiting += missing
