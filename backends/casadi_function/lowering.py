"""Lowers nodes of the IR to CasADi expressions; a value is a column of its elements in C order."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, assert_never

import casadi
import numpy as np
from numpy.typing import NDArray

from backends.ports.step_interface import Port
from compiler.ir import ops
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.types import WINDOW, Axis, Type

Expression = Any
"""A `casadi.MX`."""

Positions = NDArray[np.int64]


def positions(type: Type) -> Positions:
    """The index of each element in the column that stores a value of this type, as an array of the
    type's shape.
    """
    return np.arange(type.size, dtype=np.int64).reshape(type.shape)


def gather(column: Expression, wanted: Positions) -> Expression:
    """A column with the elements of `column` at the indices `wanted`, in C order of `wanted`."""
    flat = wanted.ravel()
    # omit a trivial selection: each node costs time in every call
    if np.array_equal(flat, np.arange(column.numel())):
        return column
    if column.numel() == 1:  # indexing a 1×1 matrix gives a row
        return casadi.repmat(column, flat.size, 1)
    return column[flat.tolist()]


def broadcast(column: Expression, operand: Type, result: Type) -> Expression:
    """The column of a value of type `operand` after a broadcast to type `result`: repeated along
    missing axes, with axes in the order of the result.
    """
    names = [axis.name for axis in result.axes if axis.name in operand.axis_names]
    order = [operand.position(name) for name in names]
    index = tuple(
        slice(None) if axis.name in operand.axis_names else np.newaxis for axis in result.axes
    )
    # align axes by name (R3); missing ones get length 1
    placed = positions(operand).transpose(order)[index]
    return gather(column, np.broadcast_to(placed, result.shape))


def concat(columns: Sequence[Expression], operands: Sequence[Type], axis: str) -> Expression:
    """The column of the concatenation of values, given as columns with their types, along the axis
    with this name.
    """
    # vertcat stacks the columns: indices are offset by the previous operands
    ends = np.cumsum([operand.size for operand in operands])
    parts = [
        positions(operand) + end - operand.size for operand, end in zip(operands, ends, strict=True)
    ]
    order = np.concatenate(parts, axis=operands[0].position(axis))
    return gather(casadi.vertcat(*columns), order)


def total(column: Expression, operand: Type, axis: str) -> Expression:
    """The column of the sum of a value over the axis with this name."""
    terms = np.moveaxis(positions(operand), operand.position(axis), 0)
    # a matrix whose columns are the terms, summed along its rows
    return casadi.sum2(_matrix(column, terms.reshape(terms.shape[0], -1)))


def contract(
    left: Expression, right: Expression, operands: tuple[Type, Type], result: Type, axis: str
) -> Expression:
    """The column of Σ over the axis with this name of the product of two values: a matrix product,
    unless the values share further axes. `operands` are their types, `result` is that of the sum.
    """
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
    """A matrix whose column k has the elements of `column` at the indices in row k of `columns`."""
    # CasADi is column-major: a row of `columns` becomes a column
    count, length = columns.shape
    return casadi.reshape(gather(column, columns), length, count)


@dataclass(frozen=True, slots=True)
class Symbols:
    """The CasADi expressions of input ports, states and parameters, by name in the spec."""

    ports: Mapping[str, tuple[Port, Expression]]
    """Ports from which signal reads take their samples."""
    states: Mapping[str, Expression]
    parameters: Mapping[str, Expression]


@contextmanager
def exact_arithmetic() -> Generator[None]:
    """Context manager: within it, CasADi does not simplify expressions such as 0·x to 0 and x − x
    to 0, which would hide NaN. The switch is global in CasADi.
    """
    # a global switch of CasADi, restored also after an error
    before = casadi.GlobalOptions.getSimplificationOnTheFly()
    casadi.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        yield
    finally:
        casadi.GlobalOptions.setSimplificationOnTheFly(before)


def lower_nodes(
    graph: Graph, nodes: Sequence[NodeId], symbols: Symbols
) -> dict[NodeId, Expression]:
    """The CasADi expressions of `nodes` by node id. `nodes` contains all operands, each before its
    users.
    """
    values: dict[NodeId, Expression] = {}
    for index in nodes:
        node = graph[index]
        operands = [values[arg] for arg in node.args]
        values[index] = _lower(node, operands, [graph[arg].type for arg in node.args], symbols)
    return values


def _lower(node: Node, values: list[Expression], types: list[Type], symbols: Symbols) -> Expression:
    match node.op:
        case ops.Constant(numbers):
            return casadi.MX(casadi.DM(list(numbers)))
        case ops.ReadParameter(name):
            return symbols.parameters[name]
        case ops.ReadSignal(name, first, last) | ops.ReadLog(name, first, last):
            return _read(*symbols.ports[name], first, last)
        case ops.ReadState(name):
            return symbols.states[name]
        case ops.ReadTraining():
            raise AssertionError("no program reads values of training")
        case ops.Add():
            return values[0] + values[1]
        case ops.Subtract():
            return values[0] - values[1]
        case ops.Multiply():
            return values[0] * values[1]
        case ops.Divide():
            return values[0] / values[1]
        case ops.Negate():
            return -values[0]
        case ops.Identity():
            return values[0]
        case ops.Minimum():
            # not fmin, which ignores a NaN operand, unlike the interpreter
            return _nearer(values[0] <= values[1], values[0] > values[1], values)
        case ops.Maximum():
            return _nearer(values[0] >= values[1], values[0] < values[1], values)
        case ops.Clamp():
            value, low, high = values
            above = _nearer(value >= low, value < low, [value, low])
            return _nearer(above <= high, above > high, [above, high])
        case ops.Compare(relation):
            return _compare(relation, values[0], values[1])
        case ops.Select():
            # CasADi evaluates both branches; differentiation needs `guard_untaken` before
            return casadi.if_else(values[0], values[1], values[2])
        case ops.Apply(function):
            return getattr(casadi, SCALAR_FUNCTIONS[function].casadi)(*values)
        case ops.Broadcast():
            return broadcast(values[0], types[0], node.type)
        # the order of elements does not change
        case ops.Reshape():
            return values[0]
        case ops.Slice(axis, start, stop):
            kept = (*(slice(None),) * types[0].position(axis), slice(start, stop))
            return gather(values[0], positions(types[0])[kept])
        case ops.Concat(axis):
            return concat(values, types, axis)
        case ops.Sum(axis):
            return total(values[0], types[0], axis)
        case ops.Contract(axis):
            return contract(values[0], values[1], (types[0], types[1]), node.type, axis)
        case ops.Window(state):
            return _window(symbols.states[state], values[0], node.type)
        case _ as never:
            assert_never(never)


def _read(port: Port, column: Expression, first: int, last: int) -> Expression:
    # a read of the whole port needs no selection
    if (first, last) == (port.first, port.last):
        return column
    kept = slice(first - port.first, last - port.first + 1)
    return gather(column, positions(port.type)[..., kept])


def _window(buffer: Expression, newest: Expression, window: Type) -> Expression:
    *axes, last = window.axes
    parts = [Type((*axes, Axis(WINDOW, last.size - 1))), Type((*axes, Axis(WINDOW, 1)))]
    return concat([buffer, newest], parts, WINDOW)


def _nearer(first: Expression, second: Expression, values: list[Expression]) -> Expression:
    """The first value if the condition `first` holds, the second if `second` holds, otherwise NaN:
    neither holds if a value is NaN.
    """
    left, right = values
    # if neither comparison holds, one operand is NaN, and so is the sum
    return casadi.if_else(first, left, casadi.if_else(second, right, left + right))


def _compare(relation: ops.Relation, left: Expression, right: Expression) -> Expression:
    match relation:
        case ops.Relation.LESS:
            return left < right
        case ops.Relation.LESS_EQUAL:
            return left <= right
        case ops.Relation.GREATER:
            return left > right
        case ops.Relation.GREATER_EQUAL:
            return left >= right
        case _ as never:
            assert_never(never)
