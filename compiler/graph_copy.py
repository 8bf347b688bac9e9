"""Copies nodes from one graph into another that a pass is building."""

from __future__ import annotations

from collections.abc import Iterable

from compiler.builder import GraphBuilder
from compiler.program import Graph, Node, NodeId
from compiler.types import WINDOW


def copy_node(builder: GraphBuilder, node: Node, args: tuple[NodeId, ...]) -> NodeId:
    """The node with new operands, its type, place and name kept; an equal one is used again."""
    with builder.at(node.span):
        copied = builder.emit(node.op, args, node.type)
    if node.label is not None:
        builder.name(copied, node.label)
    return copied


def copy_nodes(
    builder: GraphBuilder, graph: Graph, nodes: Iterable[NodeId]
) -> dict[NodeId, NodeId]:
    """Copies the nodes, operands before users, and returns where each of them is now."""
    copies: dict[NodeId, NodeId] = {}
    for index in nodes:
        node = graph[index]
        copies[index] = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
    return copies


def samples(
    builder: GraphBuilder, value: NodeId, oldest: int, read: tuple[int, int], like: Node
) -> NodeId:
    """Samples t+first … t+last of a value whose window begins at t+oldest, as `like` has them.

    `like` is the node that read them before: without a window axis in its type the one sample.
    """
    first, last = read
    part = builder.slice(value, WINDOW, first - oldest, last - oldest + 1)
    return builder.reshape(part, like.type.axes)
