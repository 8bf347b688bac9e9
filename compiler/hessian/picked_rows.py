"""Replaces products with constant selection matrices by slices."""

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
"""Maximum number of slices; beyond it, the loop of the product is cheaper."""


def with_picked_rows(graph: Graph, *, exact: int = 0) -> tuple[Graph, dict[NodeId, NodeId]]:
    """Replaces such products after the first `exact` nodes; returns the graph and the new node ids.

    Σ over k of C[d, k] · x[k, …], with at most one nonzero element in each row d of C, is that
    element times x[k(d), …]. Such products arise from derivatives in unit directions.
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
        # an operand with the axis of the rows is aligned elementwise, not multiplied as a vector
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
    """Rows start … stop−1 that select consecutive elements or are 0; None if there are too many
    runs.
    """
    nonzero = values != 0
    # two nonzero elements in a row are a sum, not a slice
    if (nonzero.sum(axis=1) > 1).any():
        return None
    # offset of the selected column from its row: constant in a run; None for rows of zeros
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
