"""Replaces products with constant matrices whose rows pick one element each by slices."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import Axis

_MOST_RUNS = 8
"""Slices that are worth more than the loop of the product."""


def with_picked_rows(graph: Graph, *, exact: int = 0) -> tuple[Graph, dict[NodeId, NodeId]]:
    """The graph without such products beyond its first `exact` nodes, and where each node is.

    Σ over k of C[d, k] · x[k, …] with at most one number other than 0 in each row d of C is
    x[k(d), …] times that number: what a matrix has as slopes at unit directions is the matrix.
    """
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        args = tuple(copies[arg] for arg in node.args)
        made: NodeId | None = None
        if index >= exact and isinstance(node.op, ops.Contract):
            with builder.at(node.span):
                made = _picked(builder, node, node.op.axis, args)
        copies[index] = copy_node(builder, node, args) if made is None else made
    return builder.graph(), copies


def _picked(b: GraphBuilder, node: Node, axis: str, args: Sequence[NodeId]) -> NodeId | None:
    for matrix, other in (args, args[::-1]):
        op, axes = b.node(matrix).op, b.type(matrix).axes
        if not isinstance(op, ops.Constant) or len(axes) != 2:
            continue
        (rows,) = (a for a in axes if a.name != axis)
        # an operand that has the axis of the rows itself is aligned with it, not multiplied by it
        if b.type(other).axis(rows.name) is not None:
            continue
        values = np.reshape(op.values, b.type(matrix).shape)
        values = values if axes[0] is rows else values.T
        runs = _runs(values)
        if runs is not None:
            parts = [_rows(b, node, values[slice(*run)], axis, rows, other) for run in runs]
            return b.concat(parts, rows.name) if len(parts) > 1 else parts[0]
    return None


def _runs(values: NDArray[np.float64]) -> list[tuple[int, int]] | None:
    """Rows start … stop−1 that pick elements one after the other, or nothing; None if too many."""
    nonzero = values != 0
    # two numbers in a row are a sum, which no slice is
    if (nonzero.sum(axis=1) > 1).any():
        return None
    # how far ahead of its row the picked column is: rows that pick one after the other share it,
    # rows of zeros have None
    ahead = np.where(nonzero.any(axis=1), nonzero.argmax(axis=1) - np.arange(len(values)), None)
    runs: list[tuple[int, int]] = []
    for _, group in groupby(range(len(values)), key=lambda row: ahead[row]):
        members = list(group)
        runs.append((members[0], members[-1] + 1))
    return runs if len(runs) <= _MOST_RUNS else None


def _rows(
    b: GraphBuilder, node: Node, values: NDArray[np.float64], axis: str, rows: Axis, other: NodeId
) -> NodeId:
    here = Axis(rows.name, len(values))
    axes = tuple(here if a.name == rows.name else a for a in node.type.axes)
    numbers = values.sum(axis=1)
    if not numbers.any():
        return b.broadcast(b.constant(0.0, unit=None), axes)
    first = int(np.flatnonzero(values[0])[0])
    part = b.slice(other, axis, first, first + len(values))
    renamed = tuple(here if a.name == axis else a for a in b.type(part).axes)
    part = b.broadcast(b.reshape(part, renamed), axes)
    if (numbers == 1).all():
        return part
    return b.multiply(part, b.broadcast(b.constant(numbers, (here,), unit=None), axes))
