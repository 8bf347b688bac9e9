"""Simplifies slices of slices and of concatenations, which then need no copy."""

from __future__ import annotations

from dataclasses import replace

from compiler.ir.ops import Concat, Reshape, Slice
from compiler.ir.program import Graph, Node, NodeId


def forward_slices(graph: Graph) -> Graph:
    """The graph with every slice taken directly from the source of its elements; ids do not change.

    %3: concat(%0, %1) over t;  %4: %3[t, 5:6]    ->    %4: %1[t, 1:2]
    """
    nodes: list[Node] = []
    for _, node in graph:
        nodes.append(_forwarded(nodes, node))
    return Graph(tuple(nodes))


def _forwarded(nodes: list[Node], node: Node) -> Node:
    while isinstance(node.op, Slice):
        source = nodes[node.args[0]]
        match source.op:
            case Slice(axis, start, _) if axis == node.op.axis:
                node = _taken(nodes, node, source.args[0], node.op.start + start)
            case Concat(axis) if axis == node.op.axis:
                found = _part(nodes, source, node.op)
                if found is None:
                    return node
                node = _taken(nodes, node, *found)
            case _:
                return node
    return node


def _taken(nodes: list[Node], node: Node, source: NodeId, start: int) -> Node:
    """The slice of another node, or a reshape of that node if it is the whole of it."""
    assert isinstance(node.op, Slice)
    size = node.op.stop - node.op.start
    whole = nodes[source].type.axes == node.type.axes
    # the node must stay, so that ids do not change; a reshape to the same shape is free
    op = Reshape() if whole else Slice(node.op.axis, start, start + size)
    return replace(node, op=op, args=(source,))


def _part(nodes: list[Node], concat: Node, wanted: Slice) -> tuple[NodeId, int] | None:
    """The part that contains all elements of the slice, and their start in it."""
    begin = 0
    for part in concat.args:
        type = nodes[part].type
        size = type.axes[type.position(wanted.axis)].size
        if begin <= wanted.start and wanted.stop <= begin + size:
            return part, wanted.start - begin
        begin += size
    return None
