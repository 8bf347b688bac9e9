"""Stores the nodes of a graph that is being built, equal ones once."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from compiler.ir.ops import Constant, Op
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import Type
from spec_schema.diagnostics.source import Span
from spec_schema.units.unit import Unit


class NodeStore:
    """Grows a `Graph`, node by node."""

    def __init__(self, graph: Graph | None = None) -> None:
        self._nodes: list[Node] = list(graph.nodes) if graph else []
        self._known: dict[_Key, NodeId] = {}
        for index, node in enumerate(self._nodes):
            # where a given graph has equal nodes, users made from here on take the first
            self._known.setdefault(_key(node.op, node.args, node.type), index)
        self._span: Span | None = None

    def graph(self) -> Graph:
        return Graph(tuple(self._nodes))

    def type(self, node: NodeId) -> Type:
        return self._nodes[node].type

    def node(self, node: NodeId) -> Node:
        return self._nodes[node]

    @contextmanager
    def at(self, span: Span | None) -> Generator[None]:
        """Nodes made inside carry this place of the spec."""
        previous, self._span = self._span, span or self._span
        try:
            yield
        finally:
            self._span = previous

    def name(self, node: NodeId, label: str) -> None:
        """Remember what the spec calls this value; the first name stays."""
        if self._nodes[node].label is None:
            self._nodes[node] = replace(self._nodes[node], label=label)

    def set_unit(self, node: NodeId, unit: Unit | None) -> None:
        """Give a value whose unit was not known the one that the spec declares for it."""
        found = self._nodes[node]
        # the key of the node stays the old one: the same formula written again finds it, unit and
        # all
        if found.type.unit is None:
            self._nodes[node] = replace(found, type=found.type.with_unit(unit))

    def rename_unit(self, node: NodeId, unit: Unit) -> None:
        """Call the unit of a value as the spec does: `W` in place of the `V*A` of its formula."""
        found = self._nodes[node]
        self._nodes[node] = replace(found, type=found.type.with_unit(unit))

    def emit(
        self, op: Op, args: tuple[NodeId, ...], type: Type, span: Span | None = None
    ) -> NodeId:
        """The node with this operation, operands and type, made if there is none yet."""
        new = len(self._nodes)
        # one look alone: to hash a key takes as long as to make a node
        found = self._known.setdefault(_key(op, args, type), new)
        if found == new:
            self._nodes.append(Node(op, args, type, span or self._span))
        return found


_Key = tuple[Op, tuple[NodeId, ...], Type, bytes]


def _key(op: Op, args: tuple[NodeId, ...], type: Type) -> _Key:
    """The key by which nodes are the same; 0.0 == -0.0, but the constants are different numbers."""
    bits = np.array(op.values).tobytes() if isinstance(op, Constant) else b""
    return op, args, type, bits
