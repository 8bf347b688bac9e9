"""Translates a node into a function that computes its value with numpy; this defines the meaning of
each operation.

Values have the batch as their first axis; a value that is equal for the whole batch may have a
batch of 1. All backends evaluate sums and selections in this order, so that C reproduces them bit
for bit:

- a sum starts with element 0 and adds the others one after the other (`np.add.accumulate`, which is
  sequential by definition; `np.sum` is pairwise);
- `Minimum(a, b)` is a where a <= b or a is NaN, else b; `Maximum` uses >=. A tie, also of −0 and
  +0, gives the first operand, and NaN propagates;
- `Clamp(x, low, high)` is Minimum(Maximum(x, low), high).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from compiler.ir import ops
from compiler.ir.nodes import needed
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.types import Type
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.errors import names as errors
from spec_schema.late_dataclass import dataclass

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class LeafValues:
    """The values that a graph reads: the log, (rows, *shape) by signal; the row number `t` of each
    member; and the states, (B, *shape) by name.
    """

    log: Mapping[str, Array]
    t: NDArray[np.int64]
    states: Mapping[str, Array]


NOWHERE = LeafValues({}, np.zeros(1, np.int64), {})
"""Leaf values of nodes that depend on constants only."""

Evaluator = Callable[[list[Array], LeafValues], Array]

_RELATIONS: dict[ops.Relation, Callable[[Array, Array], Array]] = {
    ops.Relation.LESS: np.less,
    ops.Relation.LESS_EQUAL: np.less_equal,
    ops.Relation.GREATER: np.greater,
    ops.Relation.GREATER_EQUAL: np.greater_equal,
}


def evaluator(
    node: Node,
    operands: tuple[Type, ...],
    weights: Mapping[str, Array],
    dtype: np.dtype[Any],
) -> Evaluator:
    """A function (values, leaves) → array that computes the node from the values of all nodes,
    indexed by node id, and the leaf values.

    `operands` are the types of the node's operands, `weights` the physical arrays by parameter
    name. Real results have exactly `dtype`.
    """
    args, shape = node.args, node.type.shape
    match node.op:
        case ops.Constant(values):
            with np.errstate(over="ignore"):  # beyond float32 a constant is infinite, as in C
                constant = np.array(values, dtype).reshape((1, *shape))
            return lambda values, around: constant
        case ops.ReadParameter(name):
            weight = np.asarray(weights[name], dtype).reshape((1, *shape))
            return lambda values, around: weight
        case ops.ReadSignal(name, first, last) | ops.ReadLog(name, first, last):
            return _read(name, first, last, node.type, dtype)
        case ops.ReadState(name):
            return lambda values, around: around.states[name]
        case ops.ReadTraining():
            raise AssertionError("no program reads values of training")
        case ops.Add():
            return _binary(np.add, args)
        case ops.Subtract():
            return _binary(np.subtract, args)
        case ops.Multiply():
            return _binary(np.multiply, args)
        case ops.Divide():
            return _binary(np.divide, args)
        case ops.Negate():
            return lambda values, around: np.negative(values[args[0]])
        case ops.Identity():
            return lambda values, around: values[args[0]]
        case ops.Minimum():
            return _binary(_minimum, args)
        case ops.Maximum():
            return _binary(_maximum, args)
        case ops.Clamp():
            value, low, high = args
            return lambda values, around: _minimum(
                _maximum(values[value], values[low]), values[high]
            )
        case ops.Compare(relation):
            return _binary(_RELATIONS[relation], args)
        case ops.Select():
            condition, then, otherwise = args
            return lambda values, around: np.where(
                values[condition], values[then], values[otherwise]
            )
        case ops.Apply(function):
            return _apply(function, args, dtype)
        case ops.Broadcast():
            place = _placement(operands[0], node.type)
            return lambda values, around: _repeated(place(values[args[0]]), shape)
        case ops.Reshape():
            return lambda values, around: values[args[0]].reshape((-1, *shape))
        case ops.Slice(axis, start, stop):
            ahead = operands[0].position(axis) + 1
            # the batch is the first axis
            index = (*(slice(None),) * ahead, slice(start, stop))
            return lambda values, around: values[args[0]][index]
        case ops.Concat(axis):
            position = operands[0].position(axis) + 1
            return lambda values, around: _concatenated([values[arg] for arg in args], position)
        case ops.Sum(axis):
            position = operands[0].position(axis) + 1
            return lambda values, around: _sum(np.moveaxis(values[args[0]], position, 0))
        case ops.Contract(axis):
            left, right = args
            put_left = _placement(operands[0], node.type, axis)
            put_right = _placement(operands[1], node.type, axis)
            return lambda values, around: _sum(put_left(values[left]) * put_right(values[right]))
        case ops.Window(state):
            return lambda values, around: _concatenated(
                [around.states[state], values[args[0]][..., np.newaxis]], -1
            )
        case _:
            assert_never(node.op)


def _binary(function: Callable[[Array, Array], Array], args: tuple[int, ...]) -> Evaluator:
    left, right = args
    return lambda values, around: function(values[left], values[right])


def _read(name: str, first: int, last: int, type: Type, dtype: np.dtype[Any]) -> Evaluator:
    if type.window is None:
        return lambda values, around: around.log[name][around.t + first].astype(dtype, copy=False)
    offsets = np.arange(first, last + 1)

    def window(values: list[Array], around: LeafValues) -> Array:
        # (batch, window, …): the window then moves to the last axis
        samples = around.log[name][around.t[:, np.newaxis] + offsets]
        return np.moveaxis(samples, 1, -1).astype(dtype, copy=False)

    return window


def _apply(function: str, args: tuple[int, ...], dtype: np.dtype[Any]) -> Evaluator:
    row = SCALAR_FUNCTIONS[function]
    if row.kernel is None or dtype == np.float64:
        # for non-contiguous memory numpy may use another code path, with other last bits
        def by_numpy(values: list[Array], around: LeafValues) -> Array:
            return row.numpy(*(np.ascontiguousarray(values[arg]) for arg in args))

        return by_numpy
    # float32 uses the kernels of the C code and rounds like it; float64 is the reference
    from compiler.kernels.table import evaluate  # float64 users do not pay for its tables

    kernel = row.kernel
    return lambda values, around: evaluate(kernel, *(values[arg] for arg in args))


def _minimum(left: Array, right: Array) -> Array:
    return np.where((left <= right) | np.isnan(left), left, right)


def _maximum(left: Array, right: Array) -> Array:
    return np.where((left >= right) | np.isnan(left), left, right)


def _placement(operand: Type, result: Type, summed: str | None = None) -> Callable[[Array], Array]:
    """A function that moves the axes of an operand to their places in the result's type; axes that
    the operand lacks get length 1.

    The batch is the first axis. With `summed`, the axis of this name comes before it.
    """
    names = operand.axis_names
    result_names = [axis.name for axis in result.axes]
    order = (0, *(names.index(name) + 1 for name in result_names if name in names))
    if summed is not None:
        order = (names.index(summed) + 1, *order)
    # before the axes of the result: the batch, and before it the summed axis
    leading = (slice(None),) * (len(order) - sum(name in names for name in result_names))
    index = (*leading, *(slice(None) if name in names else np.newaxis for name in result_names))
    return lambda value: value.transpose(order)[index]


def _repeated(value: Array, shape: tuple[int, ...]) -> Array:
    return np.broadcast_to(value, (value.shape[0], *shape))


def _concatenated(parts: list[Array], position: int) -> Array:
    batch = max(part.shape[0] for part in parts)
    return np.concatenate([repeated_batch(part, batch) for part in parts], axis=position)


def repeated_batch(value: Array, batch: int) -> Array:
    """The value with a first axis of length `batch`: repeated if that axis had length 1."""
    if value.shape[0] == batch:
        return value
    return np.broadcast_to(value, (batch, *value.shape[1:]))


def _sum(terms: Array) -> Array:
    """The sum of `terms` over the first axis, one after the other: ((e₀ + e₁) + e₂) + …."""
    return np.add.accumulate(terms, axis=0)[-1]


def constant_value(graph: Graph, node: NodeId) -> Array:
    """The float64 value of a node, an array in the shape of its axes. The node must depend on
    constants only; a read of a parameter or state raises KeyError.
    """
    values: list[Any] = [None] * len(graph)
    with np.errstate(all="ignore"):
        for index, live in enumerate(needed(graph, [node])):
            if live:
                types = tuple(graph[arg].type for arg in graph[index].args)
                evaluate = evaluator(graph[index], types, {}, np.dtype(np.float64))
                values[index] = evaluate(values, NOWHERE)
    # the batch has size 1, since the value reads nothing
    return values[node][0]


_ARITHMETIC = (ops.Add, ops.Subtract, ops.Multiply, ops.Divide, ops.Apply)


def never_finite(program: Program) -> list[Diagnostic]:
    """Warnings (diagnostics) for the places in the spec where the step divides by the constant 0 or
    computes an infinite or NaN constant. The passes must have folded constants before.
    """
    graph = program.step
    found: dict[Diagnostic, None] = {}
    for _, node in graph:
        operands = [graph[arg].op for arg in node.args]
        # constant terms have been folded, unless the result is infinite or NaN
        constant = bool(operands) and all(isinstance(op, ops.Constant) for op in operands)
        by_zero = isinstance(node.op, ops.Divide) and _is_zero(graph, node.args[1])
        if node.span is not None and isinstance(node.op, _ARITHMETIC) and (constant or by_zero):
            found[errors.never_finite(node.span)] = None
    return list(found)


def _is_zero(graph: Graph, node: NodeId) -> bool:
    op = graph[graph.unrepeated(node)].op
    return isinstance(op, ops.Constant) and not all(op.values)
