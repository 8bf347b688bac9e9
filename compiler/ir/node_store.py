"""Stores the nodes of a growing graph; equal nodes are stored once."""

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
    """Grows a `Graph` node by node, without duplicates."""

    def __init__(self, graph: Graph | None = None) -> None:
        self._nodes: list[Node] = list(graph.nodes) if graph else []
        self._known: dict[_Key, NodeId] = {}
        for index, node in enumerate(self._nodes):
            # if the initial graph has equal nodes, new users take the first
            self._known.setdefault(_key(node.op, node.args, node.type), index)
        self._span: Span | None = None

    def graph(self) -> Graph:
        return Graph(tuple(self._nodes))

    @property
    def size(self) -> int:
        """The number of nodes."""
        return len(self._nodes)

    def type(self, node: NodeId) -> Type:
        return self._nodes[node].type

    def node(self, node: NodeId) -> Node:
        return self._nodes[node]

    @contextmanager
    def at(self, span: Span | None) -> Generator[None]:
        """Nodes that are added inside the `with` block get this place in the spec."""
        previous, self._span = self._span, span or self._span
        try:
            yield
        finally:
            self._span = previous

    def name(self, node: NodeId, label: str) -> None:
        """Sets the label of a node: the name of this value in the spec. An existing label stays."""
        if self._nodes[node].label is None:
            self._nodes[node] = replace(self._nodes[node], label=label)

    def set_unit(self, node: NodeId, unit: Unit | None) -> None:
        """Sets the unit of a value whose unit is unknown to the one that the spec declares."""
        current = self._nodes[node]
        # the key of the node does not change, so the same formula, repeated, finds this node
        if current.type.unit is None:
            self._nodes[node] = replace(current, type=current.type.with_unit(unit))

    def rename_unit(self, node: NodeId, unit: Unit) -> None:
        """Writes the unit of a value as the spec does: `W` instead of the derived `V*A`."""
        current = self._nodes[node]
        self._nodes[node] = replace(current, type=current.type.with_unit(unit))

    def emit(
        self, op: Op, args: tuple[NodeId, ...], type: Type, span: Span | None = None
    ) -> NodeId:
        """Returns the node with this operation, operands and type; adds it if there is none."""
        new = len(self._nodes)
        # a single lookup: hashing the key is as slow as making the node
        index = self._known.setdefault(_key(op, args, type), new)
        if index == new:
            self._nodes.append(Node(op, args, type, span or self._span))
        return index


_Key = tuple[Op, tuple[NodeId, ...], Type, bytes]


def _key(op: Op, args: tuple[NodeId, ...], type: Type) -> _Key:
    """The key of equal nodes. Constants are compared by their bits, since 0.0 == -0.0."""
    bits = np.array(op.values).tobytes() if isinstance(op, Constant) else b""
    return op, args, type, bits
