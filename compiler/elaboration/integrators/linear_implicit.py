"""Solves the linear system of the linearly implicit Euler method, expanded into operations."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from compiler.differentiation.gradient_nodes import element_gradients
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Constant
from compiler.ir.program import NodeId
from compiler.ir.types import UNNAMED, Axis
from compiler.jacobian.sparsity_pattern import nonzero_elements
from spec_schema.units.parser import parse_unit

_SECOND = parse_unit("s")

Row = dict[int, NodeId]
"""The structurally nonzero elements of a matrix row, by column."""


def increments(
    builder: GraphBuilder, values: Mapping[str, NodeId], slopes: Mapping[str, NodeId], step: float
) -> dict[str, NodeId]:
    """Δ of each state: (I − h J) Δ = h f with the derivatives f (`slopes`) and J = ∂f/∂x at
    `values`.

    Gaussian elimination without pivoting. No pivot is near 0 while h J is small compared with I. If
    J is diagonally dominant and stable, all pivots are at least 1 for any h. Structural zeros cost
    nothing.
    """
    # with an unknown unit in the system, the unit of a row of I − h J is unknown
    known = all(builder.type(value).unit is not None for value in values.values())
    h = builder.constant(step, unit=_SECOND if known else None)
    matrix: list[Row] = []
    right: list[NodeId] = []
    for name in values:
        slope = slopes[name]
        matrix += _rows(builder, len(matrix), slope, values, h)
        for index in range(builder.type(slope).size):
            right.append(builder.multiply(h, scalar_of(builder, slope, index)))
    solution = solved(builder, matrix, right)
    found: dict[str, NodeId] = {}
    for name, value in values.items():
        axes = builder.type(value).axes
        size = builder.type(value).size
        parts = [builder.reshape(node, (Axis(UNNAMED, 1),)) for node in solution[:size]]
        joined = builder.concat(parts, UNNAMED) if size > 1 else parts[0]
        found[name] = builder.reshape(joined, axes)
        # unknowns are in the order of `values`: each state takes its elements from the front
        del solution[:size]
    return found


def scalar_of(builder: GraphBuilder, value: NodeId, index: int) -> NodeId:
    """One element of a value; `index` counts in C order."""
    flat = builder.reshape(value, (Axis(UNNAMED, builder.type(value).size),))
    return builder.element(flat, UNNAMED, index)


def _rows(
    builder: GraphBuilder, number: int, slope: NodeId, values: Mapping[str, NodeId], h: NodeId
) -> list[Row]:
    """The rows of I − h J for the elements of one derivative; `number` is the index of the first
    row.
    """
    rows: list[Row] = []
    jacobian = element_gradients(builder, slope, list(values.values()))
    nodes = [gradient for gradients in jacobian for gradient in gradients if gradient is not None]
    nonzero = nonzero_elements(builder.graph(), nodes)
    for gradients in jacobian:
        row: Row = {number + len(rows): builder.constant(1.0)}
        column = 0
        for value, gradient in zip(values.values(), gradients, strict=True):
            if gradient is not None:
                for index in np.flatnonzero(nonzero[gradient]).tolist():
                    scaled = builder.multiply(h, scalar_of(builder, gradient, index))
                    before = row.get(column + index)
                    row[column + index] = difference(builder, before, scaled)
            column += builder.type(value).size
        rows.append(row)
    return rows


def solved(builder: GraphBuilder, matrix: list[Row], right: list[NodeId]) -> list[NodeId]:
    """Solves A x = b by Gaussian elimination and back substitution; returns x.

    It modifies `matrix` and `right`.
    """
    size = len(matrix)
    for k in range(size):
        for i in range(k + 1, size):
            # structurally 0: nothing to eliminate
            if k not in matrix[i]:
                continue
            # no pivoting: the size of elements is unknown at compile time (decision 0241)
            factor = _quotient(builder, matrix[i].pop(k), matrix[k][k])
            for j in [column for column in matrix[k] if column > k]:
                product = builder.multiply(factor, matrix[k][j])
                matrix[i][j] = difference(builder, matrix[i].get(j), product)
            right[i] = builder.subtract(right[i], builder.multiply(factor, right[k]))
    solution: list[NodeId] = list(right)
    for k in reversed(range(size)):
        total = right[k]
        # in the order of columns, which fixes the rounding of the sum
        for j in sorted(column for column in matrix[k] if column > k):
            total = builder.subtract(total, builder.multiply(matrix[k][j], solution[j]))
        solution[k] = _quotient(builder, total, matrix[k][k])
    return solution


def difference(builder: GraphBuilder, left: NodeId | None, right: NodeId) -> NodeId:
    """left − right; a structurally zero `left` has no node."""
    return builder.negate(right) if left is None else builder.subtract(left, right)


def _quotient(builder: GraphBuilder, left: NodeId, right: NodeId) -> NodeId:
    # rows that depend on no state have the pivot 1 of I
    return left if builder.node(right).op == Constant((1.0,)) else builder.divide(left, right)
