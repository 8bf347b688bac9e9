"""Records the value that each gradient was taken of."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId


class GradientSources:
    """The value that each gradient was taken of. The gradient of 3·x is a constant, but uses x."""

    def __init__(self) -> None:
        # node ids are unique within a graph only: the builder distinguishes step and start
        self._sources: dict[tuple[int, NodeId], list[NodeId]] = {}

    def remember(self, builder: GraphBuilder, result: NodeId, value: NodeId) -> None:
        """Records that `result` is a gradient of `value`."""
        self._sources.setdefault((id(builder), result), []).append(value)

    def made_of(self, builder: GraphBuilder, value: NodeId) -> set[NodeId]:
        """The nodes that a value depends on, including those that a gradient in it eliminated."""
        reached: set[NodeId] = set()
        waiting = [value]
        while waiting:
            node = waiting.pop()
            if node not in reached:
                reached.add(node)
                waiting += builder.node(node).args
                waiting += self._sources.get((id(builder), node), ())
        return reached
