"""Defines nodes and graphs: operations on typed values in static single assignment form."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field

from compiler.ir.ops import Broadcast, Op
from compiler.ir.types import Type
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass

NodeId = int
"""Index of a node in its graph; operands have smaller indices than the nodes that use them."""


@dataclass(frozen=True, slots=True)
class Node:
    """One operation: its operands, the static type of its value and its place in the spec."""

    op: Op
    args: tuple[NodeId, ...]
    type: Type
    # equal operations are one node, also if the spec repeats them: it has the place of the first
    span: Span | None = field(default=None, compare=False)
    label: str | None = field(default=None, compare=False)
    """Name of the equation, output or layer with this value, for comments and reports."""


@dataclass(frozen=True, slots=True)
class Graph:
    """Nodes in an order in which they can be evaluated."""

    nodes: tuple[Node, ...] = ()

    def __getitem__(self, node: NodeId) -> Node:
        return self.nodes[node]

    def __len__(self) -> int:
        return len(self.nodes)

    def __iter__(self) -> Iterator[tuple[NodeId, Node]]:
        return iter(enumerate(self.nodes))

    def unrepeated(self, node: NodeId) -> NodeId:
        """The operand behind a chain of `Broadcast` nodes, or `node` if it is none."""
        while isinstance(self.nodes[node].op, Broadcast):
            (node,) = self.nodes[node].args
        return node
