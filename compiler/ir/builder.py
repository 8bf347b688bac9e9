"""`GraphBuilder` builds a graph of typed nodes with one method per operation; it matches the axes
of operands by their names and derives axes and unit of each result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from compiler.ir import ops
from compiler.ir.infinite_values import InfiniteValues
from compiler.ir.nodes import NodeStore
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.ir.rules import (
    Ruled,
    UnitConflict,
    addition_unit,
    align,
    contracted,
    function_unit,
    product_unit,
    quotient_unit,
    subtraction_unit,
    sum_unit,
)
from compiler.ir.scalars import SCALAR_FUNCTIONS, Array
from compiler.ir.types import WINDOW, Axis, Type, in_order
from spec_schema.diagnostics.source import Span
from spec_schema.units.unit import ONE, Unit

_ZERO_OF_ZEROS = (ops.Add, ops.Subtract, ops.Negate, ops.Broadcast, ops.Concat)


class GraphBuilder(NodeStore):
    """Adds nodes to a growing `Graph`, one method per operation. The methods take and return node
    ids.

    They derive the axes and the unit of the result. Operands whose axes do not fit raise
    AxisConflict. Units that do not fit raise nothing: they are appended to the list `conflicts`.
    """

    def __init__(self, graph: Graph | None = None) -> None:
        super().__init__(graph)
        self.conflicts: list[UnitConflict] = []
        """Unit errors since the caller last emptied the list. The caller knows their place in
        the spec."""
        self.infinite_values = InfiniteValues(self)
        self._zeros: set[NodeId] = set()
        """Nodes that are 0 for every input. In a sum they fit any unit."""
        for node_id, node in graph or ():
            self._note_zero(node_id, node.op, node.args)

    def emit(
        self, op: ops.Op, args: tuple[NodeId, ...], type: Type, span: Span | None = None
    ) -> NodeId:
        """Returns the id of the node with operation `op`, operands `args` and this type; adds the
        node if the graph has none. A new node gets the place `span`, or that of the enclosing `at`.
        """
        node = super().emit(op, args, type, span)
        self._note_zero(node, op, args)
        return node

    # ---- leaves

    def constant(
        self,
        value: float | Sequence[float] | Array,
        axes: tuple[Axis, ...] = (),
        unit: Unit | None = ONE,
        name: str = "",
    ) -> NodeId:
        """A constant with these axes. `value` is a scalar or an array with their elements in C
        order; `name` is the name of the constant in the spec, empty without one.
        """
        values = tuple(float(v) for v in np.asarray(value, dtype=float).ravel())
        return self.emit(ops.Constant(values, name), (), Type(axes, unit))

    def parameter(self, name: str, type: Type) -> NodeId:
        """Reads the parameter `name` in its physical unit; `type` has its axes and unit."""
        return self.emit(ops.ReadParameter(name), (), type)

    def signal(self, name: str, first: int, last: int, type: Type) -> NodeId:
        """Reads samples t+first … t+last of an input, in a closed loop the predicted ones. `type`
        needs a window axis of last−first+1 samples; without a window, first equals last.
        """
        return self.emit(ops.ReadSignal(name, first, last), (), type)

    def log(self, name: str, first: int, last: int, type: Type) -> NodeId:
        """Reads samples t+first … t+last of a signal as recorded, even if a closed loop predicts
        it. `type` needs a window axis of last−first+1 samples; without a window, first equals last.
        """
        return self.emit(ops.ReadLog(name, first, last), (), type)

    def state(self, name: str, type: Type) -> NodeId:
        """Reads the value at t of the state `name`; `type` has its axes and unit."""
        return self.emit(ops.ReadState(name), (), type)

    # ---- elementwise

    def add(self, left: NodeId, right: NodeId) -> NodeId:
        # `-a + b` is b - a, which matters to temperatures in degC
        if isinstance(self.node(left).op, ops.Negate):
            unit = self._unit_of_terms(subtraction_unit, right, left)
        elif isinstance(self.node(right).op, ops.Negate):
            unit = self._unit_of_terms(subtraction_unit, left, right)
        else:
            unit = self._unit_of_terms(addition_unit, left, right)
        return self._binary(ops.Add(), left, right, unit)

    def subtract(self, left: NodeId, right: NodeId) -> NodeId:
        unit = self._unit_of_terms(subtraction_unit, left, right)
        return self._binary(ops.Subtract(), left, right, unit)

    def minimum(self, left: NodeId, right: NodeId) -> NodeId:
        return self._sum_like(ops.Minimum(), "min", left, right)

    def maximum(self, left: NodeId, right: NodeId) -> NodeId:
        return self._sum_like(ops.Maximum(), "max", left, right)

    def multiply(self, left: NodeId, right: NodeId) -> NodeId:
        unit = product_unit(self.type(left).unit, self.type(right).unit)
        return self._binary(ops.Multiply(), left, right, unit)

    def divide(self, left: NodeId, right: NodeId) -> NodeId:
        unit = quotient_unit(self.type(left).unit, self.type(right).unit)
        return self._binary(ops.Divide(), left, right, unit)

    def negate(self, value: NodeId) -> NodeId:
        return self.emit(ops.Negate(), (value,), self.type(value))

    def power(self, base: NodeId, exponent: int) -> NodeId:
        """baseⁿ of an integer exponent n as a fixed sequence of squarings and products; 1 / base⁻ⁿ
        if n is negative. n = 0 gives 1 for every base, also for NaN.
        """
        if exponent < 0:
            return self.divide(self.constant(1.0), self.power(base, -exponent))
        # the order of the products fixes the rounding of a power: every backend repeats these nodes
        result: NodeId | None = None
        square = base
        while exponent:
            if exponent & 1:
                result = square if result is None else self.multiply(result, square)
            exponent >>= 1
            if exponent:
                square = self.multiply(square, square)
        # x⁰ is 1 for every x, also for 0 and NaN, as in numpy
        if result is None:
            axes = self.type(base).axes
            return self.broadcast(self.constant(1.0), axes)
        return result

    def compare(self, relation: ops.Relation, left: NodeId, right: NodeId) -> NodeId:
        # only the conflict matters: the result has no unit, but both operands need the same one
        self._ruled_sum(relation.value, left, right)
        left, right, axes = self.aligned(left, right)
        return self.emit(ops.Compare(relation), (left, right), Type(axes, ONE, "bool"))

    def select(self, condition: NodeId, then: NodeId, otherwise: NodeId) -> NodeId:
        unit = self._ruled_sum("where", then, otherwise)
        then, otherwise, _ = self.aligned(then, otherwise)
        condition, then, axes = self.aligned(condition, then)
        # if the window of the condition renamed an axis, `otherwise` needs the same name
        _, otherwise, _ = self.aligned(then, otherwise)
        return self.emit(ops.Select(), (condition, then, otherwise), Type(axes, unit))

    def clamp(self, value: NodeId, low: NodeId, high: NodeId) -> NodeId:
        unit = self._ruled_sum("clip", value, low)
        self._ruled_sum("clip", value, high)
        value, low, _ = self.aligned(value, low)
        value, high, axes = self.aligned(value, high)
        _, low, _ = self.aligned(value, low)  # the window of `high` may have renamed an axis
        return self.emit(ops.Clamp(), (value, low, high), Type(axes, unit))

    def where_negative(self, value: NodeId, then: NodeId, otherwise: NodeId) -> NodeId:
        """Element by element, `then` if `value` is below 0, else (also if it is NaN)
        `otherwise`.
        """
        is_negative = self.compare(ops.Relation.LESS, value, self.constant(0.0))
        return self.select(is_negative, then, otherwise)

    def zero_with(self, factor: NodeId, product: NodeId) -> NodeId:
        """The node `product`, a product with the factor `factor`, but 0 where the factor is 0, even
        if the other factor is infinite and 0·∞ gives NaN. Where the factor is NaN the product
        remains.
        """
        if self.infinite_values.is_never_zero(factor):
            return product
        size = self.apply("abs", factor)
        # there is no relation `==`: |factor| <= 0 holds for ±0 and is false for NaN
        is_zero = self.compare(ops.Relation.LESS_EQUAL, size, self.constant(0.0))
        zero = self.broadcast(self.constant(0.0), self.type(product).axes)
        return self.select(is_zero, zero, product)

    def apply(self, function: str, *args: NodeId) -> NodeId:
        """Applies the scalar function `function` (a key of SCALAR_FUNCTIONS, else KeyError) to one
        or two arguments, element by element.
        """
        row = SCALAR_FUNCTIONS[function]
        units = tuple(self.type(arg).unit for arg in args)
        unit, conflict = function_unit(function, row.units, units)
        if conflict:
            self.conflicts.append(conflict)
        if len(args) == 2:
            left, right, axes = self.aligned(*args)
            return self.emit(ops.Apply(function), (left, right), Type(axes, unit))
        return self.emit(ops.Apply(function), args, self.type(args[0]).with_unit(unit))

    def dropout(self, value: NodeId, rate: float, layer: str) -> NodeId:
        """Marks a value whose elements training sets to 0 at random with probability `rate`;
        `layer` is the name of the layer, empty for the function `dropout` of the language.
        """
        return self.emit(ops.Dropout(rate, layer), (value,), self.type(value))

    def named(self, value: NodeId, name: str) -> NodeId:
        """Adds a node that returns the value unchanged and marks it as the equation or output
        `name`, so that gradients with respect to it can be taken.
        """
        return self.emit(ops.Named(name), (value,), self.type(value))

    # ---- structure

    def broadcast(self, value: NodeId, axes: tuple[Axis, ...]) -> NodeId:
        """Repeats the value along the axes that it lacks. The result has exactly `axes`, in this
        order; each axis of the value must be among them.
        """
        type = self.type(value)
        if type.axes == axes:
            return value
        return self.emit(ops.Broadcast(), (value,), type.with_axes(axes))

    def reshape(self, value: NodeId, axes: tuple[Axis, ...]) -> NodeId:
        """The same elements in the same order, with other axes of the same total size."""
        type = self.type(value)
        if type.axes == axes:
            return value
        return self.emit(ops.Reshape(), (value,), type.with_axes(axes))

    def rename(self, value: NodeId, old: str, new: str) -> NodeId:
        """Renames the axis `old` of a value to `new`; an axis that becomes the window also moves to
        the end.
        """
        axes = self.type(value).axes
        if new == WINDOW:
            last = tuple(a for a in axes if a.name == old)
            axes = tuple(a for a in axes if a.name != old) + last
            value = self.broadcast(value, axes)
        return self.reshape(value, tuple(Axis(new, a.size) if a.name == old else a for a in axes))

    def slice(self, value: NodeId, axis: str, start: int, stop: int) -> NodeId:
        """Elements start … stop−1 along the axis of this name, counted from 0; the axis remains,
        shortened.
        """
        type = self.type(value)
        if (start, stop) == (0, type.axes[type.position(axis)].size):
            return value
        axes = tuple(Axis(axis, stop - start) if a.name == axis else a for a in type.axes)
        return self.emit(ops.Slice(axis, start, stop), (value,), type.with_axes(axes))

    def element(self, value: NodeId, axis: str, index: int) -> NodeId:
        """The element `index`, counted from 0, along the axis of this name; the axis is removed."""
        part = self.slice(value, axis, index, index + 1)
        rest = tuple(a for a in self.type(part).axes if a.name != axis)
        return self.reshape(part, rest)

    def concat(self, values: Sequence[NodeId], axis: str, called: str = "concat") -> NodeId:
        """Concatenates values along the axis of this name, which all of them have; their other axes
        are equal. `called` is the function's name in the spec, for a unit conflict.
        """
        types = [self.type(value) for value in values]
        # a part of unknown unit takes the unit of its neighbours, like a term of a sum
        unit = types[0].unit
        for type in types[1:]:
            unit, conflict = sum_unit(called, unit, type.unit)
            if conflict:
                self.conflicts.append(conflict)
        size = sum(type.axes[type.position(axis)].size for type in types)
        axes = tuple(Axis(axis, size) if a.name == axis else a for a in types[0].axes)
        return self.emit(ops.Concat(axis), tuple(values), Type(axes, unit))

    def sum(self, value: NodeId, axis: str) -> NodeId:
        """Sums over the axis of this name, which is removed."""
        type = self.type(value)
        rest = tuple(a for a in type.axes if a.name != axis)
        return self.emit(ops.Sum(axis), (value,), type.with_axes(rest))

    def contract(self, left: NodeId, right: NodeId) -> NodeId:
        """`left @ right`: the sum of products over the axis that rule R3 of the language chooses
        (see `contracted`). Raises AxisConflict if no axis or several fit.
        """
        mine, partner, axes = contracted(self.type(left).axes, self.type(right).axes)
        if partner != mine.name:
            right = self.rename(right, partner, mine.name)
        unit = product_unit(self.type(left).unit, self.type(right).unit)
        return self.emit(ops.Contract(mine.name), (left, right), Type(axes, unit))

    def contract_over(self, left: NodeId, right: NodeId, axis: str) -> NodeId:
        """Multiplies two values and sums over the axis of this name, which both have. Other axes
        are matched by name, and an axis that one value lacks is repeated. A window stays last.
        """
        mine, other = self.type(left), self.type(right)
        # unlike `@` this searches no partner axis: the caller names it; a window stays last
        rest = [a for a in mine.axes if a.name != axis]
        rest += [a for a in other.axes if a.name != axis and mine.axis(a.name) is None]
        unit = product_unit(mine.unit, other.unit)
        return self.emit(ops.Contract(axis), (left, right), Type(in_order(tuple(rest)), unit))

    def window(self, state: str, newest: NodeId, length: int) -> NodeId:
        """The stored samples of the buffer `state` (`length` of them, oldest first) and, last, the
        node `newest`: length+1 samples along a new window axis.
        """
        type = self.type(newest)
        return self.emit(
            ops.Window(state), (newest,), type.with_axes((*type.axes, Axis(WINDOW, length + 1)))
        )

    # ---- inside

    def aligned(self, left: NodeId, right: NodeId) -> tuple[NodeId, NodeId, tuple[Axis, ...]]:
        """Returns `left` and `right`, both broadcast to the axes of their elementwise result, and
        these axes. Raises AxisConflict if the operands' axes do not fit.
        """
        left_type, right_type = self.type(left), self.type(right)
        if left_type.axes == right_type.axes:
            return left, right, left_type.axes
        axes, left_axes, right_axes = align(left_type.axes, right_type.axes)
        left = self._as_named(left, left_axes)
        right = self._as_named(right, right_axes)
        return self.broadcast(left, axes), self.broadcast(right, axes), axes

    def _as_named(self, value: NodeId, axes: tuple[Axis, ...]) -> NodeId:
        """The value, but if it has an axis that is not in `axes`, this axis is renamed to the
        window. `axes` are the renamed axes that `align` returned for the value.
        """
        names = {axis.name for axis in axes}
        for axis in self.type(value).axes:
            if axis.name not in names:
                return self.rename(value, axis.name, WINDOW)
        return value

    def _ruled_sum(self, operation: str, left: NodeId, right: NodeId) -> Unit | None:
        left_unit, right_unit = self._term_unit(left), self._term_unit(right)
        unit, conflict = sum_unit(operation, left_unit, right_unit)
        if conflict:
            self.conflicts.append(conflict)
        return unit

    def _unit_of_terms(
        self, rule: Callable[[Unit | None, Unit | None], Ruled], left: NodeId, right: NodeId
    ) -> Unit | None:
        """Unit of a sum or a difference, by `rule`: it takes both units and returns the unit and a
        conflict or None. A literal 0 takes the unit of the other term. A conflict is added to
        `conflicts`.
        """
        for zero, other in ((left, right), (right, left)):
            if self._is_zero(zero):
                return self.type(other).unit
        unit, conflict = rule(self.type(left).unit, self.type(right).unit)
        if conflict:
            self.conflicts.append(conflict)
        return unit

    def _note_zero(self, node: NodeId, op: ops.Op, args: tuple[NodeId, ...]) -> None:
        if isinstance(op, ops.Constant):
            is_zero = not any(op.values)
        elif isinstance(op, ops.Multiply):
            is_zero = not self._zeros.isdisjoint(args)
        else:
            is_zero = isinstance(op, _ZERO_OF_ZEROS) and self._zeros.issuperset(args)
        if is_zero:
            self._zeros.add(node)

    def _is_zero(self, value: NodeId) -> bool:
        return value in self._zeros

    def _term_unit(self, value: NodeId) -> Unit | None:
        """Unit of a term of a sum; None (fits any unit) for a literal 0."""
        return None if self._is_zero(value) else self.type(value).unit

    def _sum_like(self, op: ops.Op, operation: str, left: NodeId, right: NodeId) -> NodeId:
        return self._binary(op, left, right, self._ruled_sum(operation, left, right))

    def _binary(self, op: ops.Op, left: NodeId, right: NodeId, unit: Unit | None) -> NodeId:
        left, right, axes = self.aligned(left, right)
        return self.emit(op, (left, right), Type(axes, unit))


def copy_node(builder: GraphBuilder, node: Node, args: tuple[NodeId, ...]) -> NodeId:
    """Adds the operation of `node` with the operands `args` (ids of the builder's graph), and with
    its type, place and label; reuses an equal node. Returns the id of the copy.
    """
    copied = builder.emit(node.op, args, node.type, node.span)
    if node.label is not None:
        builder.name(copied, node.label)
    return copied


def with_step(program: Program, step: Graph, copies: Mapping[NodeId, NodeId]) -> Program:
    """The program with another step graph; `copies` maps old node ids to ids in the new graph.

    It needs an entry for each node that a state, output, loss or expected range names. Raises
    KeyError for a missing one.
    """
    return replace(
        program,
        step=step,
        states=tuple(replace(state, next=copies[state.next]) for state in program.states),
        outputs=tuple(replace(output, node=copies[output.node]) for output in program.outputs),
        losses=tuple(loss.moved(copies) for loss in program.losses),
        expected=tuple(replace(entry, node=copies[entry.node]) for entry in program.expected),
    )


def with_start(program: Program, start: Graph, copies: Mapping[NodeId, NodeId]) -> Program:
    """The program with another start graph; `copies` maps the start node of each state in the old
    graph to its id in the new one. Raises KeyError for a missing one.
    """
    states = tuple(replace(state, start=copies[state.start]) for state in program.states)
    return replace(program, start=start, states=states)


def samples(
    builder: GraphBuilder, value: NodeId, oldest: int, read: tuple[int, int], like: Node
) -> NodeId:
    """Slices samples t+first … t+last, the pair `read`, out of a node `value` whose window begins
    with sample t+oldest. The result has the axes of `like`, the node that read these samples
    before. If `like` has no window axis, the result is a single sample.
    """
    first, last = read
    part = builder.slice(value, WINDOW, first - oldest, last - oldest + 1)
    return builder.reshape(part, like.type.axes)
