"""Orders nodes for evaluation when some need values of later nodes."""

from __future__ import annotations

from collections.abc import Mapping

from compiler.ir.program import Graph, NodeId


class CycleError(Exception):
    """Nodes that depend on each other within one step; each is listed before its user."""

    def __init__(self, nodes: tuple[NodeId, ...]) -> None:
        super().__init__(f"nodes {nodes} need each other")
        self.nodes = nodes


def evaluation_order(graph: Graph, feeds: Mapping[NodeId, NodeId]) -> list[NodeId]:
    """Returns all nodes, operands before users; `feeds[reader]` is one more operand of a reader.

    It keeps the order of the graph where the feeds allow it. Depth-first search without recursion;
    the time is linear in the number of nodes. Raises CycleError.
    """
    order: list[NodeId] = []
    waiting, placed = set[NodeId](), [False] * len(graph)
    for root in range(len(graph)):
        # each node is on the stack twice: first to push its operands, then to be placed
        stack = [(root, False)]
        while stack:
            node, ready = stack.pop()
            if placed[node]:
                continue
            if ready:
                waiting.discard(node)
                placed[node] = True
                order.append(node)
                continue
            if node in waiting:
                raise CycleError(_cycle(stack, node))
            waiting.add(node)
            stack.append((node, True))
            needs = graph[node].args + ((feeds[node],) if node in feeds else ())
            stack.extend((need, False) for need in reversed(needs) if not placed[need])
    return order


def _cycle(stack: list[tuple[NodeId, bool]], node: NodeId) -> tuple[NodeId, ...]:
    """The nodes of a cycle, from the operand `node` to its user: the reversed path on the stack."""
    path = [waiting for waiting, ready in stack if ready]
    return tuple(reversed(path[path.index(node) :]))
