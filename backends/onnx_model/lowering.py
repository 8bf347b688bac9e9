"""Lowers nodes of the IR to ONNX operators; a value has exactly the axes of its type."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from backends.onnx_model.near_neutral import near_neutral
from backends.onnx_model.nodes import OnnxNodes
from backends.ports.step_interface import Port
from compiler.ir import ops
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.types import Axis, Type

_RELATIONS = {
    ops.Relation.LESS: "Less",
    ops.Relation.LESS_EQUAL: "LessOrEqual",
    ops.Relation.GREATER: "Greater",
    ops.Relation.GREATER_EQUAL: "GreaterOrEqual",
}


@dataclass(frozen=True, slots=True)
class LeafNodes:
    """The value names of a graph's leaves, by name in the spec."""

    ports: Mapping[str, tuple[Port, str]]
    states: Mapping[str, str]
    parameters: Mapping[str, str]
    weights: Mapping[str, NDArray[np.float64]]
    """The values of the initialisers of parameters."""


def lower_nodes(
    graph: Graph, nodes: Sequence[NodeId], sources: LeafNodes, onnx: OnnxNodes
) -> dict[NodeId, str]:
    """Value names of `nodes`, which are ordered with operands first."""
    values: dict[NodeId, str] = {}
    # in single precision the dropped operands have no effect
    is_double = onnx.dtype == np.dtype(np.float64)
    kept = near_neutral(graph, nodes, sources.weights) if is_double else {}
    for index in nodes:
        node = graph[index]
        # viewers of ONNX show the place in the spec
        place = f"line {node.span.line}" if node.span else ""
        onnx.describe(node.label or f"n{index}", place)
        operands = [values[arg] for arg in node.args]
        types = [graph[arg].type for arg in node.args]
        shape = node.type.shape
        if index in kept:
            dropped = kept[index]
            operands[dropped] = onnx.reshaped(operands[dropped], shape, (1, *shape))
        value = _lower(node, operands, types, sources, onnx)
        values[index] = onnx.reshaped(value, (1, *shape), shape) if index in kept else value
    return values


def _lower(
    node: Node, values: list[str], types: list[Type], sources: LeafNodes, onnx: OnnxNodes
) -> str:
    shape = node.type.shape
    match node.op:
        case ops.Constant(numbers):
            return onnx.constant(np.array(numbers).reshape(shape))
        case ops.ReadParameter(name):
            return sources.parameters[name]
        case ops.ReadSignal(name, first, last) | ops.ReadLog(name, first, last):
            port, value = sources.ports[name]
            return _read(port, value, (first, last), node.type, onnx)
        case ops.ReadState(name):
            return sources.states[name]
        case ops.ReadTraining():
            raise AssertionError("no program reads values of training")
        case ops.Add():
            return onnx.add("Add", values)
        case ops.Subtract():
            return onnx.add("Sub", values)
        case ops.Multiply():
            return onnx.add("Mul", values)
        case ops.Divide():
            return onnx.add("Div", values)
        case ops.Negate():
            return onnx.add("Neg", values)
        case ops.Identity():
            return values[0]
        case ops.Minimum():
            return onnx.add("Min", values)
        case ops.Maximum():
            return onnx.add("Max", values)
        case ops.Clamp():
            # not Clip, whose limits are scalars
            return onnx.add("Min", [onnx.add("Max", values[:2]), values[2]])
        case ops.Compare(relation):
            return onnx.add(_RELATIONS[relation], values)
        case ops.Select():
            return onnx.add("Where", values)
        case ops.Apply(function):
            operator = SCALAR_FUNCTIONS[function].onnx
            assert operator is not None, f"`{function}` was to be expanded"
            return onnx.add(operator, values)
        case ops.Broadcast():
            return onnx.broadcast(values[0], types[0], node.type)
        case ops.Reshape():
            return onnx.reshaped(values[0], types[0].shape, shape)
        case ops.Slice(axis, start, stop):
            return onnx.sliced(values[0], types[0].position(axis), start, stop)
        case ops.Concat(axis):
            return onnx.add("Concat", values, axis=types[0].position(axis))
        case ops.Sum(axis):
            # axes are an input since opset 13, not an attribute
            along = onnx.integers([types[0].position(axis)])
            return onnx.add("ReduceSum", [values[0], along], keepdims=0)
        case ops.Contract(axis):
            return _contract(values, types, node.type, axis, onnx)
        case ops.Window(state):
            last = len(shape) - 1
            # oldest first: the buffer, then the newest sample (R1)
            newest = onnx.add("Unsqueeze", [values[0], onnx.integers([last])])
            return onnx.add("Concat", [sources.states[state], newest], axis=last)
        case _ as never:
            assert_never(never)


def _read(port: Port, value: str, read: tuple[int, int], type: Type, onnx: OnnxNodes) -> str:
    first, last = read
    before = port.type.shape
    # ports have the samples of all readers: select those of this one
    if read != (port.first, port.last):
        size = last - first + 1
        start = first - port.first
        value = onnx.sliced(value, len(before) - 1, start, start + size)
        before = (*before[:-1], size)
    return onnx.reshaped(value, before, type.shape)


def _contract(
    values: list[str], types: list[Type], result: Type, axis: str, onnx: OnnxNodes
) -> str:
    """A matrix product, batched over the axes that both operands keep."""
    left, right = types
    summed = left.axes[left.position(axis)]
    # MatMul sums the last axis of left and the last but one of right; axes before are batched
    shared = [a for a in result.axes if _has(left, a) and _has(right, a)]
    rows = [a for a in result.axes if _has(left, a) and a not in shared]
    columns = [a for a in result.axes if _has(right, a) and a not in shared]
    first = _arranged(values[0], left, (shared, rows, [summed]), onnx)
    second = _arranged(values[1], right, (shared, [summed], columns), onnx)
    product = onnx.add("MatMul", [first, second])
    axes = (*shared, *rows, *columns)
    after = tuple(a.size for a in axes)
    stacked = _stacked(shared, rows, columns)
    # MatMul has matrices only: split rows and columns into their axes again
    value = onnx.reshaped(product, stacked, after)
    return onnx.broadcast(value, Type(axes), result)


def _arranged(
    value: str, type: Type, groups: tuple[list[Axis], list[Axis], list[Axis]], onnx: OnnxNodes
) -> str:
    axes = [axis for group in groups for axis in group]
    # merge axes for MatMul: batch, rows, columns
    value = onnx.transposed(value, [type.position(axis.name) for axis in axes])
    return onnx.reshaped(value, tuple(axis.size for axis in axes), _stacked(*groups))


def _stacked(shared: list[Axis], rows: list[Axis], columns: list[Axis]) -> tuple[int, ...]:
    """Shape of batched matrices; an operand without rows or columns has one.

    It must not be a vector: onnxruntime 1.31 silently fuses a transposed matrix and a vector to a
    product with the matrix that is not transposed.
    """
    size = math.prod
    return (
        *(axis.size for axis in shared),
        size(axis.size for axis in rows),
        size(axis.size for axis in columns),
    )


def _has(type: Type, axis: Axis) -> bool:
    return axis.name in type.axis_names
