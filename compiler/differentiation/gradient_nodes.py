"""Adds gradients of values to a graph that is under construction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from compiler.differentiation.reverse_mode import gradients
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node
from compiler.ir.ops import Reshape
from compiler.ir.program import NodeId
from compiler.ir.rules.unit_rules import quotient_unit
from compiler.ir.scalars.table import Array
from compiler.passes.derivatives.guard_untaken import guarded


def gradient_nodes(
    builder: GraphBuilder, value: NodeId, wanted: Sequence[NodeId]
) -> list[NodeId | None]:
    """Σ ∂value/∂w over all elements of the value, for each wanted node w; None if independent of w.

    A gradient has the axes of w and the unit of value / w. Only the nodes that the value depends on
    are differentiated; untaken branches are guarded first. Nodes already in the graph are reused.
    """
    return _Differentiated(builder, value).gradients(np.ones(()), wanted)


def element_gradients(
    builder: GraphBuilder, value: NodeId, wanted: Sequence[NodeId]
) -> list[list[NodeId | None]]:
    """The same for each element of the value separately, in C order: the rows of a Jacobian."""
    differentiated = _Differentiated(builder, value)
    # one row for each element: weight 1 for it, 0 for all others
    rows = np.eye(builder.type(value).size)
    return [differentiated.gradients(row, wanted) for row in rows]


class _Differentiated:
    """A guarded copy of a value's graph and its gradients, which are copied back where needed."""

    def __init__(self, builder: GraphBuilder, value: NodeId) -> None:
        self._builder = builder
        self._value = value
        self._draft, self._guarded = guarded(builder.graph(), [value])
        # shared by all rows of a Jacobian: common nodes are copied once
        self._copies: dict[NodeId, NodeId] = {}

    def gradients(self, weights: Array, wanted: Sequence[NodeId]) -> list[NodeId | None]:
        """Σ weight · ∂value/∂w over the elements of the value; a scalar weight counts for all."""
        draft, type = self._draft, self._builder.type(self._value)
        if weights.ndim == 0:
            adjoint = draft.broadcast(draft.constant(weights), type.axes)
        else:
            adjoint = draft.constant(weights, type.axes)
        # the value does not depend on other nodes
        present = [node for node in wanted if node in self._guarded]
        inner = [self._guarded[node] for node in present]
        found = gradients(draft, {self._guarded[self._value]: adjoint}, inner)
        slopes = dict(zip(present, found, strict=True))
        results: list[NodeId | None] = []
        for node in wanted:
            slope = slopes.get(node)
            results.append(None if slope is None else self._result(slope, node))
        return results

    def _result(self, slope: NodeId, node: NodeId) -> NodeId:
        builder = self._builder
        self._copy(slope)
        copied = self._copies[slope]
        # derivative rules leave some units unknown; the unit of the result is known
        unit = quotient_unit(builder.type(self._value).unit, builder.type(node).unit)
        type = builder.type(copied)
        if unit is None or type.unit == unit:
            return copied
        return builder.emit(Reshape(), (copied,), type.with_unit(unit))

    # an explicit stack: graphs are deeper than Python's recursion limit
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
