"""Removes multiplications by a known 0 or 1 and additions of a known 0 from a graph.

Derivatives are full of them, as most variables do not affect each other. A slice of a concatenation
becomes a slice of the part that contains it, so that padding with zeros disappears too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node
from compiler.ir.liveness import needed
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import Type


def without_zeros(
    graph: Graph, roots: Sequence[NodeId], builder: GraphBuilder, *, exact: int = 0
) -> dict[NodeId, NodeId]:
    """Copies the nodes that the roots depend on into the builder; returns the new id of each root.

    0 · x becomes 0 and x + 0 becomes x for every x, which is right for structurally zero
    derivatives. Values with guaranteed bits must not be simplified this way, since 0 · ∞ and the
    sign of zero matter. The first `exact` nodes are therefore copied unchanged.
    """
    draft = _Draft()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        moved_node = replace(node, args=tuple(copies[arg] for arg in node.args))
        copies[index] = draft.copy(moved_node) if index < exact else draft.add(moved_node)
    found = {root: copies[root] for root in roots}
    whole = draft.builder.graph()
    # nodes that only produced zeros are removed before the copy
    live = needed(whole, found.values())
    moved: dict[NodeId, NodeId] = {}
    for index, node in whole:
        if live[index]:
            moved[index] = copy_node(builder, node, tuple(moved[arg] for arg in node.args))
    return {root: moved[copy] for root, copy in found.items()}


def known_number(graph: GraphBuilder, node: NodeId) -> float | None:
    """The common value of all elements, if they are one known constant; otherwise None."""
    found = graph.node(node)
    while isinstance(found.op, ops.Broadcast | ops.Reshape | ops.Slice):
        found = graph.node(found.args[0])
    if not isinstance(found.op, ops.Constant) or found.type.kind != "real":
        return None
    numbers = set(found.op.values)
    return found.op.values[0] if len(numbers) == 1 else None


class _Draft:
    """The simplified graph, as far as it is copied."""

    def __init__(self) -> None:
        self.builder = GraphBuilder()

    def copy(self, node: Node) -> NodeId:
        return copy_node(self.builder, node, node.args)

    def add(self, node: Node) -> NodeId:
        b = self.builder
        numbers = [known_number(b, arg) for arg in node.args]
        # matching compares values, so −0 counts as 0; x · 1 and x / 1 keep the bits of x
        match node.op, numbers:
            case ops.Add() | ops.Subtract(), [_, 0.0]:
                return node.args[0]
            case ops.Add(), [0.0, _]:
                return node.args[1]
            case ops.Subtract(), [0.0, _]:
                return self.add(replace(node, op=ops.Negate(), args=node.args[1:]))
            case ops.Multiply() | ops.Contract(), [0.0, _] | [_, 0.0]:
                return self._zeros(node.type)
            case ops.Divide(), [0.0, _]:
                return self._zeros(node.type)
            case ops.Multiply() | ops.Divide(), [_, 1.0]:
                return node.args[0]
            case ops.Multiply(), [1.0, _]:
                return node.args[1]
            case ((ops.Structure() | ops.Sum() | ops.Negate()), [0.0]):
                return self._zeros(node.type)
            case ops.Select(), [_, 0.0, 0.0]:
                return self._zeros(node.type)
            case ops.Concat(), _ if all(number == 0.0 for number in numbers):
                return self._zeros(node.type)
            case ops.Slice(), _:
                return self._sliced(node)
            case _:
                return self.copy(node)

    def _zeros(self, type: Type) -> NodeId:
        return self.builder.broadcast(self.builder.constant(0.0, unit=None), type.axes)

    def _sliced(self, node: Node) -> NodeId:
        b = self.builder
        assert isinstance(node.op, ops.Slice)
        axis, start, stop = node.op.axis, node.op.start, node.op.stop
        source = b.node(node.args[0])
        match source.op:
            # a slice of a slice is one slice; a slice within one part of a concatenation is a
            # slice of that part
            case ops.Slice(inner, before, _) if inner == axis:
                op = ops.Slice(axis, start + before, stop + before)
                return self.add(replace(node, op=op, args=source.args))
            case ops.Concat(inner) if inner == axis:
                begin = 0
                for part in source.args:
                    size = b.type(part).axes[b.type(part).position(axis)].size
                    if begin <= start and stop <= begin + size:
                        if size == stop - start:
                            return part
                        op = ops.Slice(axis, start - begin, stop - begin)
                        return self.add(replace(node, op=op, args=(part,)))
                    begin += size
            case _:
                pass
        return copy_node(b, node, node.args)
