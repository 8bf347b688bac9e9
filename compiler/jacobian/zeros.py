"""Finds structural zeros of values, and removes operations with a constant 0 or 1 from graphs of
derivatives.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.operations import NOWHERE, evaluator
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node
from compiler.ir.nodes import needed
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import Type

Marks = NDArray[np.float64]
"""An array of marks: 0 for structural zeros, positive for other elements."""


def nonzero_elements(graph: Graph, values: Iterable[NodeId]) -> dict[NodeId, NDArray[np.bool_]]:
    """For each of the nodes `values`, a mask in the shape of its axes: False for structural zeros.

    Zeros originate in constants and propagate through products, sums and structural operations.
    Values that are read count as nonzero, and 0 · ∞ as 0.
    """
    values = list(values)
    marks: list[Any] = [None] * len(graph)
    for index, live in enumerate(needed(graph, values)):
        if live:
            marks[index] = _marks(graph, graph[index], marks)
    return {value: np.asarray(marks[value][0] > 0) for value in values}


def _marks(graph: Graph, node: Node, marks: list[Any]) -> Marks:
    """An array (1, *shape), 0 for structural zeros of the node, otherwise positive. `marks` has
    those of earlier nodes, by id.
    """
    of = [marks[arg] for arg in node.args]
    match node.op:
        case ops.Constant(values):
            return np.reshape(np.array(values) != 0, (1, *node.type.shape)).astype(float)
        case ops.Multiply() | ops.Reduction() | ops.Structure():
            types = tuple(graph[arg].type for arg in node.args)
            # marks are ≥ 0, so that their products and sums mark products and sums
            found = evaluator(node, types, {}, np.dtype(np.float64))(marks, NOWHERE)
            return np.minimum(found, 1.0)
        case ops.Add() | ops.Subtract() | ops.Minimum() | ops.Maximum():
            return np.maximum(of[0], of[1])
        # a quotient is 0 where its dividend is: patterns ignore 0/0
        case ops.Negate() | ops.Identity() | ops.Divide():
            return of[0]
        case ops.Select():
            return np.maximum(of[1], of[2])
        case ops.Apply() | ops.Clamp() | ops.Compare() | ops.Read() | ops.Window():
            return np.ones((1, *node.type.shape))
        case _:
            assert_never(node.op)


def without_zeros(
    graph: Graph, roots: Sequence[NodeId], builder: GraphBuilder, *, exact: int = 0
) -> dict[NodeId, NodeId]:
    """Copies the nodes that the roots depend on into the builder, without operations on a constant
    0 or 1; returns the new id of each root.

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
    """The value of a constant whose elements are all equal, also after `Broadcast`, `Reshape` or
    `Slice`; None for any other node.
    """
    found = graph.node(node)
    while isinstance(found.op, ops.Broadcast | ops.Reshape | ops.Slice):
        found = graph.node(found.args[0])
    if not isinstance(found.op, ops.Constant) or found.type.kind != "real":
        return None
    numbers = set(found.op.values)
    return found.op.values[0] if len(numbers) == 1 else None


class _Draft:
    """Copies a graph node by node, and removes operations with a constant 0 or 1.

    `add` simplifies a node whose operands are already copied; `copy` keeps its operation.
    """

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
