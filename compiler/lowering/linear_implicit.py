"""Solves the linear system of the linearly implicit Euler method, written out in operations."""

from __future__ import annotations

from collections.abc import Mapping

from compiler.builder import GraphBuilder
from compiler.constant_value import constant_value
from compiler.gradient_nodes import gradient_nodes
from compiler.graph_copy import copy_node
from compiler.ops import Constant, ReadLog, ReadParameter, ReadSignal, ReadState, Window
from compiler.program import NodeId
from compiler.types import UNNAMED, Axis
from spec_schema.unit_parser import parse_unit

_SECOND = parse_unit("s")

Row = dict[int, NodeId]
"""The elements of a row of a matrix that are not 0 whatever the data."""


def increments(
    builder: GraphBuilder, values: Mapping[str, NodeId], slopes: Mapping[str, NodeId], step: float
) -> dict[str, NodeId]:
    """Δ of each state: (I − h J) Δ = h f with f the slopes and J = ∂f/∂x at the values.

    Gaussian elimination without exchange of rows: while h J is small against I no pivot is
    near 0, and while J is diagonally dominant and stable none is below 1 whatever h. Elements that
    are 0 by structure cost nothing.
    """
    h = builder.constant(step, unit=_SECOND)
    matrix: list[Row] = []
    right: list[NodeId] = []
    for name in values:
        for slope in _scalars(builder, slopes[name]):
            matrix.append(_row(builder, len(matrix), slope, values, h))
            right.append(builder.multiply(h, slope))
    solution = _solved(builder, matrix, right)
    found: dict[str, NodeId] = {}
    for name, value in values.items():
        axes = builder.type(value).axes
        size = builder.type(value).size
        parts = [builder.reshape(node, (Axis(UNNAMED, 1),)) for node in solution[:size]]
        joined = builder.concat(parts, UNNAMED) if size > 1 else parts[0]
        found[name] = builder.reshape(joined, axes)
        del solution[:size]
    return found


def _scalars(builder: GraphBuilder, value: NodeId) -> list[NodeId]:
    size = builder.type(value).size
    flat = builder.reshape(value, (Axis(UNNAMED, size),))
    return [builder.element(flat, UNNAMED, index) for index in range(size)]


def _row(
    builder: GraphBuilder, number: int, slope: NodeId, values: Mapping[str, NodeId], h: NodeId
) -> Row:
    """A row of I − h J."""
    row: Row = {number: builder.constant(1.0)}
    column = 0
    gradients = gradient_nodes(builder, slope, list(values.values()))
    for value, gradient in zip(values.values(), gradients, strict=True):
        size = builder.type(value).size
        elements = () if gradient is None else _scalars(builder, gradient)
        for index, element in enumerate(elements):
            if not _is_zero(builder, element):
                scaled = builder.multiply(h, element)
                row[column + index] = _difference(builder, row.get(column + index), scaled)
        column += size
    return row


def _is_zero(builder: GraphBuilder, node: NodeId) -> bool:
    """Whether a value is 0 by the structure of the formula: it depends on constants only."""
    draft = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    waiting = [node]
    while waiting:
        index = waiting[-1]
        found = builder.node(index)
        if isinstance(found.op, ReadParameter | ReadSignal | ReadLog | ReadState | Window):
            return False
        missing = [arg for arg in found.args if arg not in copies]
        waiting += missing
        if not missing:
            waiting.pop()
            copies[index] = copy_node(draft, found, tuple(copies[arg] for arg in found.args))
    return not constant_value(draft.graph(), copies[node]).any()


def _solved(builder: GraphBuilder, matrix: list[Row], right: list[NodeId]) -> list[NodeId]:
    """x of A x = b: Gaussian elimination, then substitution from the last row to the first."""
    size = len(matrix)
    for k in range(size):
        for i in range(k + 1, size):
            if k not in matrix[i]:
                continue
            factor = _quotient(builder, matrix[i].pop(k), matrix[k][k])
            for j in [column for column in matrix[k] if column > k]:
                product = builder.multiply(factor, matrix[k][j])
                matrix[i][j] = _difference(builder, matrix[i].get(j), product)
            right[i] = builder.subtract(right[i], builder.multiply(factor, right[k]))
    found: list[NodeId] = list(right)
    for k in reversed(range(size)):
        total = right[k]
        for j in sorted(column for column in matrix[k] if column > k):
            total = builder.subtract(total, builder.multiply(matrix[k][j], found[j]))
        found[k] = _quotient(builder, total, matrix[k][k])
    return found


def _difference(builder: GraphBuilder, left: NodeId | None, right: NodeId) -> NodeId:
    return builder.negate(right) if left is None else builder.subtract(left, right)


def _quotient(builder: GraphBuilder, left: NodeId, right: NodeId) -> NodeId:
    return left if builder.node(right).op == Constant((1.0,)) else builder.divide(left, right)
