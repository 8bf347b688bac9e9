"""Finds an order in which nodes can be evaluated when some need values that stand after them."""

from __future__ import annotations

from collections.abc import Mapping

from compiler.ir.program import Graph, NodeId


class CycleError(Exception):
    """Nodes that need each other in the same step, each before the one that uses it."""

    def __init__(self, nodes: tuple[NodeId, ...]) -> None:
        super().__init__(f"nodes {nodes} need each other")
        self.nodes = nodes


def evaluation_order(graph: Graph, feeds: Mapping[NodeId, NodeId]) -> list[NodeId]:
    """All nodes, operands before users; `feeds[reader]` is one more node that a reader needs.

    The order is the graph's own as far as the feeds allow. Depth first without recursion, linear
    in nodes. Raises CycleError.
    """
    order: list[NodeId] = []
    waiting, placed = set[NodeId](), [False] * len(graph)
    for root in range(len(graph)):
        # a node is met twice on the stack: to push what it needs, then to place it
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
    """The chain of waiting nodes from the user of `node` down to `node` itself, turned round."""
    path = [waiting for waiting, ready in stack if ready]
    return tuple(reversed(path[path.index(node) :]))
