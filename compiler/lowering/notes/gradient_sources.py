"""Remembers which value each gradient was taken of."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId


class GradientSources:
    """The value that each gradient was taken of: of 3·x it is a number, and yet x was used."""

    def __init__(self) -> None:
        # a node is a number of its graph: step and start count on their own, told apart by builder
        self._sources: dict[tuple[int, NodeId], list[NodeId]] = {}

    def remember(self, builder: GraphBuilder, result: NodeId, value: NodeId) -> None:
        """`result` is a gradient of `value`."""
        self._sources.setdefault((id(builder), result), []).append(value)

    def made_of(self, builder: GraphBuilder, value: NodeId) -> set[NodeId]:
        """The nodes that a value is made of, those included that a gradient in it cancelled."""
        found: set[NodeId] = set()
        waiting = [value]
        while waiting:
            node = waiting.pop()
            if node not in found:
                found.add(node)
                waiting += builder.node(node).args
                waiting += self._sources.get((id(builder), node), ())
        return found
