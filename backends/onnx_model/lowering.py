"""Lowers nodes of the IR to ONNX operators; a value has exactly the axes of its type."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, assert_never

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

from backends.ports.identifiers import c_identifier
from backends.ports.step_interface import Port
from compiler.interpreter.operations import NOWHERE, evaluator
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
    """The names of ONNX values that a graph reads, by name in the spec: ports, states and
    parameters.
    """

    ports: Mapping[str, tuple[Port, str]]
    states: Mapping[str, str]
    parameters: Mapping[str, str]
    weights: Mapping[str, NDArray[np.float64]]
    """The values of the initialisers of parameters."""


def lower_nodes(
    graph: Graph, nodes: Sequence[NodeId], sources: LeafNodes, onnx: OnnxNodes
) -> dict[NodeId, str]:
    """Adds ONNX operators for `nodes` to the list `onnx`; returns the name of the ONNX value of
    each node id. `nodes` contains all operands, each before its users.
    """
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
    """Adds Σ over the axis with this name of the product of two values; returns the name of the
    sum. It is a matrix product, batched over the axes that both values keep. `types` are those of
    the values, `result` is that of the sum.
    """
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
    """The shape of batched matrices: the sizes of the shared axes, number of rows, number of
    columns. Without row or column axes the number is 1. It must not be a vector: onnxruntime 1.31
    silently fuses a transposed matrix and a vector to a product with the matrix that is not
    transposed.
    """
    size = math.prod
    return (
        *(axis.size for axis in shared),
        size(axis.size for axis in rows),
        size(axis.size for axis in columns),
    )


def _has(type: Type, axis: Axis) -> bool:
    return axis.name in type.axis_names


class OnnxNodes:
    """The nodes and initialisers of an ONNX graph under construction. Values are identified by
    their names, which methods take and return. Operations that change nothing are left out.
    """

    def __init__(self, dtype: np.dtype[Any], taken: set[str]) -> None:
        self.dtype = dtype
        self.taken = taken
        """Used names, including those of ports."""
        self.nodes: list[onnx.NodeProto] = []
        self.initializers: list[onnx.TensorProto] = []
        self._shapes: dict[tuple[int, ...], str] = {}
        self._label = "value"
        self._doc = ""

    def describe(self, label: str, doc: str) -> None:
        """Sets the prefix of the names of nodes that are added from now on, and their
        documentation.
        """
        self._label = label
        self._doc = doc

    def add(self, operator: str, inputs: Sequence[str], **attributes: Any) -> str:
        """Adds a node with this ONNX operator, whose result gets a new name; returns the name.
        `inputs` are names of values.
        """
        result = c_identifier(self._label, self.taken)
        self.add_as(result, operator, inputs, **attributes)
        return result

    def add_as(self, result: str, operator: str, inputs: Sequence[str], **attributes: Any) -> None:
        """Adds a node with this ONNX operator, whose result is called `result`, a name that is
        already in `taken`. `inputs` are names of values.
        """
        node = helper.make_node(operator, inputs, [result], name=result, **attributes)
        node.doc_string = self._doc
        self.nodes.append(node)

    def numbers(self, name: str, values: NDArray[np.float64], doc: str = "") -> str:
        """Adds an initialiser (constant array) in the model's precision, called `name`, which is
        already in `taken`; returns the name.
        """
        with np.errstate(over="ignore"):  # a bound beyond float32 becomes infinite
            array = np.asarray(values, dtype=self.dtype)
        tensor = numpy_helper.from_array(array, name)
        tensor.doc_string = doc
        self.initializers.append(tensor)
        return name

    def constant(self, values: NDArray[np.float64]) -> str:
        return self.numbers(c_identifier(self._label, self.taken), values)

    def integers(self, values: Iterable[int]) -> str:
        """The name of an initialiser with these 64-bit integers, for shapes and indices; equal ones
        share one.
        """
        key = tuple(values)
        # shapes are operands in ONNX: equal ones share an initialiser
        if key not in self._shapes:
            name = c_identifier("shape_" + "_".join(map(str, key)), self.taken)
            self.initializers.append(numpy_helper.from_array(np.array(key, np.int64), name))
            self._shapes[key] = name
        return self._shapes[key]

    # ---- changes of axes that are left out where they change nothing

    def transposed(self, value: str, order: Sequence[int]) -> str:
        if list(order) == sorted(order):
            return value
        return self.add("Transpose", [value], perm=list(order))

    def reshaped(self, value: str, before: tuple[int, ...], after: tuple[int, ...]) -> str:
        if before == after:
            return value
        return self.add("Reshape", [value, self.integers(after)])

    def sliced(self, value: str, axis: int, start: int, stop: int) -> str:
        bounds = [self.integers([number]) for number in (start, stop, axis)]
        return self.add("Slice", [value, *bounds])

    def broadcast(self, value: str, operand: Type, result: Type) -> str:
        """Adds the operators of a broadcast of `value`, of type `operand`, to type `result`:
        repeated along missing axes, with axes in the order of the result. Returns the name of the
        result.
        """
        names = [axis.name for axis in result.axes if axis.name in operand.axis_names]
        value = self.transposed(value, [operand.position(name) for name in names])
        missing = [i for i, axis in enumerate(result.axes) if axis.name not in names]
        if not missing:
            return value
        # a scalar expands to any shape; other values first need their missing axes
        if names:
            value = self.add("Unsqueeze", [value, self.integers(missing)])
        return self.add("Expand", [value, self.integers(result.shape)])


_NEUTRAL: Mapping[type, float] = {
    ops.Add: 0.0,
    ops.Subtract: 0.0,
    ops.Multiply: 1.0,
    ops.Divide: 1.0,
}
_NEAR = {0.0: 1e-44, 1.0: 1e-7}
"""Slightly larger than the values that round to the neutral element, as runtimes may round
differently."""


def near_neutral(
    graph: Graph, nodes: Sequence[NodeId], weights: Mapping[str, NDArray[np.float64]]
) -> dict[NodeId, int]:
    """Node ids with the index of an operand that runtimes would wrongly drop: a constant so close
    to 0 (of a sum) or 1 (of a product) that it is equal in float32. `weights` are physical arrays
    by name.
    """
    known: list[Any] = [None] * len(graph)
    found: dict[NodeId, int] = {}
    with np.errstate(all="ignore"):
        for index in nodes:
            node = graph[index]
            if _is_known(node, known):
                types = tuple(graph[arg].type for arg in node.args)
                known[index] = evaluator(node, types, weights, np.dtype(np.float64))(known, NOWHERE)
            neutral = _NEUTRAL.get(type(node.op))
            if neutral is None or math.prod(node.type.shape) != 1:
                continue
            for place, arg in enumerate(node.args):
                value = known[arg]
                if value is not None and 0.0 < abs(value.item() - neutral) < _NEAR[neutral]:
                    found[index] = place
    return found


def _is_known(node: Node, known: Sequence[Any]) -> bool:
    if isinstance(node.op, ops.Constant | ops.ReadParameter):
        return True
    reads = isinstance(node.op, ops.Leaf | ops.Window)
    return not reads and all(known[arg] is not None for arg in node.args)
