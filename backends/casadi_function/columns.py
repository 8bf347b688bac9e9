"""Arrays as CasADi columns: one column has the elements of an array in C order.

CasADi has matrices in column-major order only. A change of axes is therefore a selection of
elements, whose indices numpy computes; a selection that changes nothing is omitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from compiler.ir.types import Axis, Type

Expression = Any
"""A `casadi.MX`."""

Positions = NDArray[np.int64]


def positions(type: Type) -> Positions:
    """The index of each element of an array in its column; the result has the type's shape."""
    return np.arange(type.size, dtype=np.int64).reshape(type.shape)


def gather(column: Expression, wanted: Positions) -> Expression:
    """A column of the elements at these indices, in the C order of `wanted`."""
    flat = wanted.ravel()
    # omit a trivial selection: each node costs time in every call
    if np.array_equal(flat, np.arange(column.numel())):
        return column
    if column.numel() == 1:  # indexing a 1×1 matrix gives a row
        return casadi.repmat(column, flat.size, 1)
    return column[flat.tolist()]


def broadcast(column: Expression, operand: Type, result: Type) -> Expression:
    """The operand repeated along missing axes, with axes in the order of the result."""
    names = [axis.name for axis in result.axes if axis.name in operand.axis_names]
    order = [operand.position(name) for name in names]
    index = tuple(
        slice(None) if axis.name in operand.axis_names else np.newaxis for axis in result.axes
    )
    # align axes by name (R3); missing ones get length 1
    placed = positions(operand).transpose(order)[index]
    return gather(column, np.broadcast_to(placed, result.shape))


def concat(columns: Sequence[Expression], operands: Sequence[Type], axis: str) -> Expression:
    """Concatenates the arrays along one axis."""
    # vertcat stacks the columns: indices are offset by the previous operands
    ends = np.cumsum([operand.size for operand in operands])
    parts = [
        positions(operand) + end - operand.size for operand, end in zip(operands, ends, strict=True)
    ]
    order = np.concatenate(parts, axis=operands[0].position(axis))
    return gather(casadi.vertcat(*columns), order)


def total(column: Expression, operand: Type, axis: str) -> Expression:
    """Σ over one axis."""
    terms = np.moveaxis(positions(operand), operand.position(axis), 0)
    # a matrix whose columns are the terms, summed along its rows
    return casadi.sum2(_matrix(column, terms.reshape(terms.shape[0], -1)))


def contract(
    left: Expression, right: Expression, operands: tuple[Type, Type], result: Type, axis: str
) -> Expression:
    """Σ over one axis of the product: a matrix product, unless the operands share more axes."""
    shared = [a for a in result.axes if all(a.name in type.axis_names for type in operands)]
    # CasADi has no batched matrix product for further shared axes, and it simplifies a product
    # with a zero matrix to 0, which would hide NaN
    if shared or left.is_zero() or right.is_zero():
        size = operands[0].axes[operands[0].position(axis)].size
        terms = Type((Axis(axis, size), *result.axes))
        products = broadcast(left, operands[0], terms) * broadcast(right, operands[1], terms)
        return total(products, terms, axis)
    first = np.moveaxis(positions(operands[0]), operands[0].position(axis), 0)
    second = np.moveaxis(positions(operands[1]), operands[1].position(axis), -1)
    length = first.shape[0]
    product = casadi.mtimes(
        _matrix(left, first.reshape(length, -1)), _matrix(right, second.reshape(-1, length))
    )
    # columns of the product belong to the right operand: in C order its axes come first
    rest_left, rest_right = (tuple(a for a in type.axes if a.name != axis) for type in operands)
    return broadcast(casadi.vec(product), Type((*rest_right, *rest_left)), result)


def _matrix(column: Expression, columns: Positions) -> Expression:
    """The matrix whose columns are the elements in the rows of `columns`."""
    # CasADi is column-major: a row of `columns` becomes a column
    count, length = columns.shape
    return casadi.reshape(gather(column, columns), length, count)
