"""Leaves out of a graph what multiplies by a known 0 or 1 or adds a known 0.

Derivatives are full of them: most things do not depend on one another. Slices are taken from the
part of a concatenation that they lie in, so that zeros which only surround a number go too.
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
    """Copies what the roots need into the builder; where each of them is there.

    0 · x counts as 0 and x + 0 as x whatever x is, as for a derivative that is 0 by the structure
    of a model: values, where an infinity times 0 or the sign of a zero matters, are not to be
    copied this way if bits of them are promised: the first `exact` nodes are copied as they are.
    """
    draft = _Draft()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        moved_node = replace(node, args=tuple(copies[arg] for arg in node.args))
        copies[index] = draft.copy(moved_node) if index < exact else draft.add(moved_node)
    found = {root: copies[root] for root in roots}
    whole = draft.builder.graph()
    # what only made zeros is dropped before it reaches the builder
    live = needed(whole, found.values())
    moved: dict[NodeId, NodeId] = {}
    for index, node in whole:
        if live[index]:
            moved[index] = copy_node(builder, node, tuple(moved[arg] for arg in node.args))
    return {root: moved[copy] for root, copy in found.items()}


def known_number(graph: GraphBuilder, node: NodeId) -> float | None:
    """The number that every element of the value is, where it is one known number."""
    found = graph.node(node)
    while isinstance(found.op, ops.Broadcast | ops.Reshape | ops.Slice):
        found = graph.node(found.args[0])
    if not isinstance(found.op, ops.Constant) or found.type.kind != "real":
        return None
    numbers = set(found.op.values)
    return found.op.values[0] if len(numbers) == 1 else None


class _Draft:
    """The graph without its zeros, as far as it is copied."""

    def __init__(self) -> None:
        self.builder = GraphBuilder()

    def copy(self, node: Node) -> NodeId:
        return copy_node(self.builder, node, node.args)

    def add(self, node: Node) -> NodeId:
        b = self.builder
        numbers = [known_number(b, arg) for arg in node.args]
        # numbers match by value, so that −0 counts as 0 too; x · 1 and x / 1 keep the bits of x
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
            # a slice of a slice is one slice; of a concatenation it is in one part, or stays as it
            # is
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
