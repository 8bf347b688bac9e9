"""Node and builder types for the layers and functions of plug-ins. Such a node cannot be used as a
number, and such a builder checks its arguments.

`msnn.extending` has `PluginBuilder` as `GraphBuilder` and `PluginNode` as `NodeId`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any, NoReturn, TypeVar, cast

import numpy as np

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import NodeId
from compiler.ir.rules import AxesOfSources, UnitConflict, broken_rule
from compiler.ir.scalars import SCALAR_FUNCTIONS, Array
from compiler.ir.types import Axis, Type, describe_axes
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass
from spec_schema.plugins import PluginPart
from spec_schema.units.unit import ONE, Unit

_NO_SOURCES = AxesOfSources(parameters={}, states={}, signals={})
_NO_VALUE = "a node has no value while a spec is compiled: write"
_OPERATORS = {
    "add": "add",
    "sub": "subtract",
    "mul": "multiply",
    "truediv": "divide",
    "pow": "power",
    "matmul": "contract",
}
_UNARY = {"neg": "negate(x)", "abs": "apply('abs', x)", "float": "apply('tanh', x)"}


def _refused(repair: str) -> Callable[..., NoReturn]:
    def refuse(*operands: object) -> NoReturn:
        del operands
        raise TypeError(f"{_NO_VALUE} {repair}")

    return refuse


@dataclass(frozen=True, slots=True, repr=False)
class PluginNode:
    """A node of a graph, as plug-ins receive it. Operators such as `x + y` raise TypeError with the
    builder's method to call instead.
    """

    index: NodeId
    graph: GraphBuilder

    __array_ufunc__ = None
    """Makes operators of numpy arrays and numbers fail as well."""

    def __repr__(self) -> str:
        return "a node of the builder"

    def __bool__(self) -> bool:
        raise TypeError(f"{_NO_VALUE} `builder.compare` and `builder.select`")


for _symbol, _method in _OPERATORS.items():
    for _side in ("", "r"):
        setattr(PluginNode, f"__{_side}{_symbol}__", _refused(f"`builder.{_method}(x, y)`"))
for _symbol, _call in _UNARY.items():
    setattr(PluginNode, f"__{_symbol}__", _refused(f"`builder.{_call}`"))
for _symbol in ("lt", "le", "gt", "ge"):
    setattr(PluginNode, f"__{_symbol}__", _refused("`builder.compare` and `builder.select`"))

K = TypeVar("K")


def checked(value: object, kind: type[K], wanted: str) -> K:
    """Returns `value`. Raises TypeError if it is not of the class `kind`; `wanted` names what it
    must be, for the message.
    """
    if not isinstance(value, kind):
        raise TypeError(f"{_shown(value)} is not {wanted}")
    return value


def _shown(value: object) -> str:
    is_short = isinstance(value, int | float | str | None)
    return f"`{value!r}`" if is_short and len(repr(value)) < 40 else f"a {type(value).__name__}"


class PluginBuilder:
    """Adds core operations to a graph, for a plug-in. Its methods take and return nodes.

    The axes and the unit of a result follow from those of the operands, whose axes are matched by
    their names. Every method raises TypeError for a number instead of a node, and ValueError for an
    axis or an element that the node does not have.
    """

    def __init__(self, builder: GraphBuilder | None = None) -> None:
        self._builder = GraphBuilder() if builder is None else builder

    @property
    def conflicts(self) -> Sequence[UnitConflict]:
        """The operations on values whose units do not fit; they are reported at the call in the
        spec.
        """
        return tuple(self._builder.conflicts)

    def type(self, node: PluginNode) -> Type:
        """The axes and the unit of a value."""
        return self._builder.type(self._index(node))

    def constant(
        self,
        value: float | Sequence[float] | Array,
        axes: Sequence[Axis] = (),
        unit: Unit | None = ONE,
    ) -> PluginNode:
        """A number, or an array with its elements in C order of the axes; dimensionless by default,
        of unknown unit with `unit=None`. Raises ValueError if it is not finite or has another size
        than the axes.
        """
        values = np.asarray(value, dtype=float)
        if not np.all(np.isfinite(values)):
            raise ValueError("a constant has a value that is not finite")
        count = int(np.prod([axis.size for axis in _axes(axes)]))
        if values.size != count:
            raise ValueError(f"a constant has {values.size} elements, and its axes {count}")
        return self._made(self._builder.constant(values, _axes(axes), _unit(unit)))

    def add(self, left: PluginNode, right: PluginNode) -> PluginNode:
        """left + right, element by element."""
        return self._binary(self._builder.add, left, right)

    def subtract(self, left: PluginNode, right: PluginNode) -> PluginNode:
        """left - right, element by element."""
        return self._binary(self._builder.subtract, left, right)

    def multiply(self, left: PluginNode, right: PluginNode) -> PluginNode:
        """left * right, element by element."""
        return self._binary(self._builder.multiply, left, right)

    def divide(self, left: PluginNode, right: PluginNode) -> PluginNode:
        """left / right, element by element."""
        return self._binary(self._builder.divide, left, right)

    def negate(self, value: PluginNode) -> PluginNode:
        """-value, element by element."""
        return self._made(self._builder.negate(self._index(value)))

    def power(self, base: PluginNode, exponent: int) -> PluginNode:
        """base to the power of an integer, element by element, as a sequence of products. Raises
        TypeError for another exponent.
        """
        index = self._index(base)
        if isinstance(exponent, PluginNode):
            raise TypeError("a node is no exponent: write `builder.apply('pow', base, exponent)`")
        return self._made(self._builder.power(index, _whole(exponent, "the exponent")))

    def minimum(self, left: PluginNode, right: PluginNode) -> PluginNode:
        """The smaller one of two values, element by element."""
        return self._binary(self._builder.minimum, left, right)

    def maximum(self, left: PluginNode, right: PluginNode) -> PluginNode:
        """The larger one of two values, element by element."""
        return self._binary(self._builder.maximum, left, right)

    def clamp(self, value: PluginNode, low: PluginNode, high: PluginNode) -> PluginNode:
        """The value limited to low … high, element by element."""
        return self._made(self._builder.clamp(*map(self._index, (value, low, high))))

    def apply(self, function: str, *args: PluginNode) -> PluginNode:
        """A scalar function of the language, such as `tanh`, element by element. Raises ValueError
        for an unknown function or a wrong number of arguments.
        """
        row = SCALAR_FUNCTIONS.get(checked(function, str, "the name of a scalar function"))
        if row is None:
            raise ValueError(f"`{function}` is no scalar function")
        if len(args) != row.arity:
            raise ValueError(f"`{function}` takes {row.arity} nodes, and got {len(args)}")
        return self._made(self._builder.apply(function, *map(self._index, args)))

    def compare(self, relation: Relation, left: PluginNode, right: PluginNode) -> PluginNode:
        """A condition, true for the elements where `left relation right` holds, such as left <
        right with `Relation.LESS`; false where one is NaN.
        """
        found = checked(relation, Relation, "a `msnn.extending.Relation`, such as `Relation.LESS`")
        return self._made(self._builder.compare(found, self._index(left), self._index(right)))

    def select(self, condition: PluginNode, then: PluginNode, otherwise: PluginNode) -> PluginNode:
        """Element by element, `then` where the condition is true, else `otherwise`. Raises
        TypeError if `condition` is no result of `compare`.
        """
        if self.type(condition).kind != "bool":
            raise TypeError("the condition is no comparison: write `builder.compare(...)`")
        return self._made(self._builder.select(*map(self._index, (condition, then, otherwise))))

    def sum(self, value: PluginNode, axis: str) -> PluginNode:
        """The sum over the axis of this name, which is removed."""
        return self._made(self._builder.sum(self._index(value), self._axis(value, axis).name))

    def contract(self, left: PluginNode, right: PluginNode) -> PluginNode:
        """left @ right: the sum of products over the axis that rule R3 of the language chooses,
        usually the last of `left`. Raises AxisConflict if no axis or several fit.
        """
        return self._binary(self._builder.contract, left, right)

    def contract_over(self, left: PluginNode, right: PluginNode, axis: str) -> PluginNode:
        """The sum of products over the axis of this name, which both values have. Other axes are
        matched by name.
        """
        name = self._axis(right, self._axis(left, axis).name).name
        found = self._builder.contract_over(self._index(left), self._index(right), name)
        return self._made(found)

    def slice(self, value: PluginNode, axis: str, start: int, stop: int) -> PluginNode:
        """Elements start … stop-1, counted from 0, along the axis of this name; the axis remains.
        Raises ValueError for elements that it does not have.
        """
        first, end = _whole(start, "the start"), _whole(stop, "the end")
        size = self._axis(value, axis).size
        if not 0 <= first < end <= size:
            raise ValueError(f"the axis `{axis}` has {size} elements, not [{first}, {end})")
        return self._made(self._builder.slice(self._index(value), axis, first, end))

    def element(self, value: PluginNode, axis: str, index: int) -> PluginNode:
        """The element `index`, counted from 0, along the axis of this name, which is removed.
        Raises ValueError for an element that it does not have.
        """
        first = _whole(index, "the index")
        size = self._axis(value, axis).size
        if not 0 <= first < size:
            raise ValueError(f"the axis `{axis}` has {size} elements, and none at {first}")
        return self._made(self._builder.element(self._index(value), axis, first))

    def concat(self, values: Sequence[PluginNode], axis: str) -> PluginNode:
        """The values one after the other along the axis of this name, which all of them have.
        Raises ValueError without values.
        """
        nodes = [self._index(value) for value in values]
        if not nodes:
            raise ValueError("`concat` has no values")
        for value in values:
            self._axis(value, axis)
        return self._made(self._builder.concat(nodes, axis))

    def broadcast(self, value: PluginNode, axes: Sequence[Axis]) -> PluginNode:
        """The value, repeated along the axes that it lacks; the result has exactly `axes`, in this
        order.
        """
        return self._made(self._builder.broadcast(self._index(value), _axes(axes)))

    def reshape(self, value: PluginNode, axes: Sequence[Axis]) -> PluginNode:
        """The same elements in the same order, with other axes of the same number of elements."""
        return self._made(self._builder.reshape(self._index(value), _axes(axes)))

    def rename(self, value: PluginNode, old: str, new: str) -> PluginNode:
        """The value, with the name `new` for its axis `old`."""
        name = checked(new, str, "the name of an axis")
        return self._made(
            self._builder.rename(self._index(value), self._axis(value, old).name, name)
        )

    def _index(self, node: object) -> NodeId:
        return index_in(self._builder, node)

    def _made(self, index: NodeId) -> PluginNode:
        return PluginNode(index, self._builder)

    def _binary(
        self, make: Callable[[NodeId, NodeId], NodeId], left: PluginNode, right: PluginNode
    ) -> PluginNode:
        return self._made(make(self._index(left), self._index(right)))

    def _axis(self, value: PluginNode, axis: str) -> Axis:
        axes = self.type(value).axes
        name = checked(axis, str, "the name of an axis")
        found = next((each for each in axes if each.name == name), None)
        if found is None:
            raise ValueError(f"the value is {describe_axes(axes)}, and has no axis `{name}`")
        return found


def _axes(axes: object) -> tuple[Axis, ...]:
    wanted = "a tuple of `msnn.extending.Axis`"
    if not isinstance(axes, Sequence):
        raise TypeError(f"{_shown(axes)} is not {wanted}")
    return tuple(checked(axis, Axis, f"in {wanted}") for axis in cast("Sequence[object]", axes))


def _unit(unit: object) -> Unit | None:
    wanted = "a `msnn.extending.Unit`: write `parse_unit('m/s')`"
    return None if unit is None else checked(unit, Unit, wanted)


def _whole(number: object, what: str) -> int:
    try:
        return operator.index(cast("int", number))
    except TypeError:
        raise TypeError(f"{what} is {_shown(number)}, not an integer") from None


def guarded_expansion(
    part: PluginPart,
    expand: Callable[..., object],
    builder: GraphBuilder,
    place: Span,
    *arguments: Any,
) -> NodeId:
    """The id of the node that the function `expand` of the plug-in's `part` returns for these
    arguments. Raises SpecError (E0230) at `place` if it fails, returns no value of the builder or
    adds an illegal node.
    """
    known = builder.size

    def fault(node: object, *arguments: object) -> str | None:
        del arguments
        reason = fault_of_node(node, builder)
        if reason is None and builder.type(cast("PluginNode", node).index).kind == "bool":
            reason = "a comparison, not a value: use it in `builder.select`"
        return _fault_of_nodes(builder, known) if reason is None else f"returned {reason}"

    def at(*arguments: object) -> Span:
        del arguments
        return place

    return cast("PluginNode", part.guarded(expand, fault, at)(*arguments)).index


def index_in(builder: GraphBuilder, node: object) -> NodeId:
    """The id of a plug-in's node in the graph of the builder. Raises TypeError for a number, or for
    a node of another graph.
    """
    fault = fault_of_node(node, builder)
    if fault is not None:
        raise TypeError(f"got {fault}")
    return cast("PluginNode", node).index


def fault_of_node(node: object, builder: GraphBuilder) -> str | None:
    """A text that says why an object is no node of the builder, such as "`2.0`, which is a number,
    …"; None if it is one.
    """
    if isinstance(node, PluginNode):
        is_ours = node.graph is builder
        return None if is_ours else "a node of another graph: do not keep nodes between calls"
    if isinstance(node, int | float | np.number | np.ndarray):
        shown = _shown(cast("object", node))
        repair = shown.strip("`") if shown.startswith("`") else "..."
        return f"{shown}, which is a number, not a node: write `builder.constant({repair})`"
    return f"{_shown(node)}, which is not a node of the builder"


def _fault_of_nodes(builder: GraphBuilder, known: int) -> str | None:
    """The first rule that a node with an id from `known` on breaks, as the end of a sentence; None
    if there is none. The verifier checks all rules later.
    """
    for index in range(known, builder.size):
        node = builder.node(index)
        # other leaves read what the spec declares, which the verifier compares
        if not node.args and not isinstance(node.op, ops.Constant):
            continue
        reason = broken_rule(node, tuple(map(builder.type, node.args)), _NO_SOURCES)
        if reason is not None:
            return f"made a wrong node {type(node.op).__name__}: {reason}"
    return None
