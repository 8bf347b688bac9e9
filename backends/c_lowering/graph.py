"""Lowers a graph to C statements; each value is computed once.

A value is either a place in memory or an expression at its use. Structural operations (broadcast,
slice, reshape, window) only change the indexing of a place. A value whose elements are used once is
computed in the statement or loop of its user; other values are stored in a local. A `LeafSource`
gives the places of inputs, parameters and states, so the step, the start and training kernels share
this code.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol, assert_never

from backends.c_language.functions import scalar_operation
from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope, SpecName
from backends.c_language.tree import Binary, Expression
from backends.c_lowering.fuzzy_sets import ActiveMemberships, ActiveSums, active_memberships
from backends.c_lowering.state_memory import ShiftBuffer
from backends.c_lowering.sums import sum_along, write_moving_sum
from backends.c_lowering.values import (
    Computed,
    Indices,
    LocalValues,
    Value,
    copy_value,
    depth_of,
    element_of,
    repeated,
    sliced,
    with_units_moved,
)
from compiler.ir import ops
from compiler.ir.ops import Concat, Reshape, Slice
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import WINDOW, Axis, Type
from compiler.passes.analyses.compact_sets import CompactSets

_DENSE = ActiveSums()
"""Every set of every sum is evaluated."""

_STILL: Mapping[NodeId, ShiftBuffer] = {}
"""No sum shifts a buffer."""

_DEEPEST = 40
"""Maximum nesting of expressions; deeper values are stored, so that recursion is bounded."""


class LeafSource(Protocol):
    """Gives the C places of values that a graph reads but does not compute: samples, parameters,
    states.
    """

    def read(self, op: ops.AnyRead, type: Type) -> ArrayView:
        """The place of the samples, the parameter or the state that `op` reads, with the shape of
        `type`.
        """
        ...

    def push(self, op: ops.Window, newest: ArrayView, scope: BlockScope) -> ArrayView | None:
        """Writes statements to `scope` that append the newest sample to the buffer of `op`. Returns
        the place of its window, or None if the memory has no place with all samples of the window.
        """
        ...


class GraphLowering:
    """Translates the nodes that `roots` depend on to C. Values that must be stored are written to
    local variables in `scope` at once; all others are written where they are used. `surroundings`
    gives the places of leaves. `active` and `moving` are sums that skip inactive fuzzy sets or
    shift a buffer.
    """

    def __init__(
        self,
        graph: Graph,
        roots: Sequence[NodeId],
        surroundings: LeafSource,
        scope: BlockScope,
        locals: LocalValues,
        active: ActiveSums = _DENSE,
        moving: Mapping[NodeId, ShiftBuffer] = _STILL,
    ) -> None:
        # slices move to the operands first, so that unused elements are not computed
        self._graph = forward_slices(graph)
        self._surroundings = surroundings
        self._scope = scope
        self._locals = locals
        self._active = active
        self._moving = moving
        self._degrees: dict[NodeId, ActiveMemberships] = {}
        self._values: dict[NodeId, Value] = {}
        for index, demand in enumerate(use_counts(self._graph, roots, active.sets)):
            if demand:
                node = self._graph[index]
                value = self._value(index, node)
                # a value with one use is computed there; otherwise it is stored in a local, as C
                # compilers do not share work between loops
                often = demand == MANY and index not in active.parts
                if isinstance(value, Computed) and (often or value.depth > _DEEPEST):
                    value = locals.kept(node, value, locals.name(node), scope)
                self._values[index] = value

    def value(self, node: NodeId) -> Value:
        """The C value of a node: a place in memory, or a `Computed` that writes each element.
        Raises KeyError for a node that no root depends on.
        """
        return self._values[node]

    def place(self, node: NodeId, name: str) -> ArrayView:
        """The place of a node's value in memory. A value without one is first written to a local
        variable `name`.
        """
        value = self._values[node]
        return value if isinstance(value, ArrayView) else self.copy(node, name)

    def copy(self, node: NodeId, name: str) -> ArrayView:
        """Writes the value of a node to a new local variable called `name`, and returns its
        place.
        """
        value = self._values[node]
        kept = self._locals.kept(self._graph[node], value, name, self._scope)
        self._values[node] = kept
        return kept

    def store(self, node: NodeId, target: ArrayView) -> None:
        """Writes statements that copy all elements of a node to the place `target`."""
        self._locals.notes.write(self._graph[node], self._scope)
        copy_value(self._values[node], target, self._scope, self._locals.unroll)

    def store_part(self, node: NodeId, part: Value, target: ArrayView) -> None:
        """Writes statements that copy the value `part`, some of the elements of the node, to the
        place `target`. The node is for the comment.
        """
        self._locals.notes.write(self._graph[node], self._scope)
        copy_value(part, target, self._scope, self._locals.unroll)

    def _value(self, index: NodeId, node: Node) -> Value:
        if index in self._active.sets:
            return self._active_memberships(index, node)
        args = [self._values[arg] for arg in node.args]
        match node.op:
            case ops.Constant(values, name):
                own = name or node.label
                shown = SpecName(own) if own else "constants"
                return self._locals.known(values, node.type, shown, self._scope, of_spec=bool(name))
            case ops.Read():
                return self._surroundings.read(node.op, node.type)
            case ops.Broadcast():
                return repeated(args[0], self._operand(node), node.type)
            case ops.Reshape():
                return self._reshaped(node, args[0])
            case ops.Identity():
                return args[0]
            case ops.Slice(axis, start, stop):
                return sliced(args[0], self._operand(node).position(axis), start, stop)
            case ops.Concat(axis):
                return self._joined(node, args, self._operand(node).position(axis))
            case ops.Window():
                return self._window(node, node.op, args[0])
            case ops.Sum(axis) | ops.Contract(axis):
                types = [self._graph[arg].type for arg in node.args]
                factors = list(zip(args, types, strict=True))
                if index in self._moving:
                    return self._moving_sum(node, factors, self._moving[index])
                sets = self._active.sums.get(index)
                active = () if sets is None else self._degrees[sets].positions
                return sum_along(node, axis, factors, self._locals, active)
            case ops.Elementwise():
                return self._elementwise(node, node.op, args)
            case _:
                assert_never(node.op)

    def _active_memberships(self, index: NodeId, node: Node) -> Computed:
        """The degrees of membership of a node, of which only elements of active sets may be
        read.
        """
        sets = self._active.sets[index]
        value = element_of(self._values[sets.value], (), self._scope)
        points, known = self._values[sets.points], self._graph[sets.points]
        assert isinstance(points, ArrayView)
        # constant knots may be evenly spaced: then one product finds the active set
        numbers = known.op.values if isinstance(known.op, ops.Constant) else None
        found = active_memberships(
            node, sets.shape, value, points, numbers, self._locals, self._scope
        )
        self._degrees[index] = found

        def make(indices: Indices, scope: BlockScope) -> Expression:
            return found.degrees[found.positions.index(indices[0])]

        return Computed(node.type.shape, make, 1)

    def _moving_sum(
        self, node: Node, factors: Sequence[tuple[Value, Type]], memory: ShiftBuffer
    ) -> ArrayView:
        """Writes the loop of a sum over a buffer that also shifts the buffer, and returns the place
        of the sum. `factors` are the factors of its terms, one of them the window of `memory`.
        """
        locals = self._locals
        weights = [(v, type) for v, type in factors if v != memory.window]

        def term(along: Index, sample: Expression, scope: BlockScope) -> Expression:
            for value, type in weights:
                indices = [along if axis.name == WINDOW else Index() for axis in type.axes]
                weight = element_of(value, indices, scope)
                sample = scalar_operation(ops.Multiply(), (weight, sample), locals.functions)
            return sample

        # one factor is the shifted window; the sum itself appends the newest sample
        (newest,) = (
            self._values[self._graph[arg].args[0]]
            for arg in node.args
            if self._values[arg] == memory.window
        )
        locals.notes.write(node, self._scope)
        name = locals.name(node, "sum")
        sample = element_of(newest, (), self._scope)
        total = write_moving_sum(memory, sample, name, term, locals.block, self._scope)
        return ArrayView.single(total).reshaped_single(node.type.shape)

    def _operand(self, node: Node) -> Type:
        return self._graph[node.args[0]].type

    def _elementwise(self, node: Node, op: ops.Computed, args: Sequence[Value]) -> Computed:
        def make(indices: Indices, scope: BlockScope) -> Expression:
            operands = tuple(element_of(arg, indices, scope) for arg in args)
            if isinstance(op, ops.Select) and isinstance(operands[1], Binary):
                # MISRA's precedence rule forbids operations between `?` and `:`
                then = scope.constant(self._locals.name(node), operands[1])
                operands = (operands[0], then, operands[2])
            return scalar_operation(op, operands, self._locals.functions, node.type.kind)

        def finish(value: Expression, scope: BlockScope) -> Expression:
            return self._locals.finished(node, value, scope)

        return Computed(node.type.shape, make, 1 + max(map(depth_of, args)), finish)

    def _reshaped(self, node: Node, value: Value) -> Value:
        if isinstance(value, Computed):
            assert only_units_moved(self._operand(node), node.type)
            return with_units_moved(value, value.shape, node.type.shape)
        place = value.reshaped(node.type.shape)
        if place is None:
            source, name = self._graph[node.args[0]], self._locals.name(node)
            # a view with gaps cannot be reshaped by strides: copy it
            place = self._locals.kept(source, value, name, self._scope).reshaped(node.type.shape)
            assert place is not None
        return place

    def _joined(self, node: Node, parts: Sequence[Value], axis: int) -> ArrayView:
        self._locals.notes.write(node, self._scope)
        whole = self._locals.array(node, self._locals.name(node), self._scope)
        begin = 0
        for part in parts:
            end = begin + part.shape[axis]
            target = whole.sliced(axis, begin, end)
            copy_value(part, target, self._scope, self._locals.unroll)
            begin = end
        return whole

    def _window(self, node: Node, op: ops.Window, newest: Value) -> ArrayView:
        assert isinstance(newest, ArrayView)
        place = self._surroundings.push(op, newest, self._scope)
        if place is not None:
            return place
        *axes, window = node.type.axes
        # a buffer without room for the newest sample (a delay line): copy the window to a local
        past = node.type.with_axes((*axes, Axis(WINDOW, window.size - 1)))
        last = newest.reshaped((*newest.shape, 1))
        assert last is not None  # adding an axis of length 1 is always possible
        parts = [self._surroundings.read(ops.ReadState(op.state), past), last]
        return self._joined(node, parts, len(axes))


def forward_slices(graph: Graph) -> Graph:
    """The graph in which every slice of a concatenation or slice reads the source of its elements
    directly; node ids do not change. Example, where %n is node n and `t` an axis:

        %3: concat(%0, %1) over t;  %4: %3[t, 5:6]    ->    %4: %1[t, 1:2]
    """
    nodes: list[Node] = []
    for _, node in graph:
        nodes.append(_forwarded(nodes, node))
    return Graph(tuple(nodes))


def _forwarded(nodes: list[Node], node: Node) -> Node:
    while isinstance(node.op, Slice):
        source = nodes[node.args[0]]
        match source.op:
            case Slice(axis, start, _) if axis == node.op.axis:
                node = _taken(nodes, node, source.args[0], node.op.start + start)
            case Concat(axis) if axis == node.op.axis:
                found = _part(nodes, source, node.op)
                if found is None:
                    return node
                node = _taken(nodes, node, *found)
            case _:
                return node
    return node


def _taken(nodes: list[Node], node: Node, source: NodeId, start: int) -> Node:
    """`node`, a slice, as a slice of `source` that begins at `start`; if it is the whole of
    `source`, as a reshape of it.
    """
    assert isinstance(node.op, Slice)
    size = node.op.stop - node.op.start
    whole = nodes[source].type.axes == node.type.axes
    # the node must stay, so that ids do not change; a reshape to the same shape is free
    op = Reshape() if whole else Slice(node.op.axis, start, start + size)
    return replace(node, op=op, args=(source,))


def _part(nodes: list[Node], concat: Node, wanted: Slice) -> tuple[NodeId, int] | None:
    """For a slice `wanted` of a concatenation: the operand that contains all of it, and the start
    of the slice in this operand. None if it spans several operands.
    """
    begin = 0
    for part in concat.args:
        type = nodes[part].type
        size = type.axes[type.position(wanted.axis)].size
        if begin <= wanted.start and wanted.stop <= begin + size:
            return part, wanted.start - begin
        begin += size
    return None


MANY = 2
"""Any number of uses above one."""

_NO_SETS: Mapping[NodeId, CompactSets] = {}


def use_counts(
    graph: Graph, roots: Iterable[NodeId], active: Mapping[NodeId, CompactSets] = _NO_SETS
) -> list[int]:
    """For each node: 0 (no root depends on it), 1 (each element is read at most once), or MANY. A
    value with 1 can be computed where it is read; one with MANY is better stored. Reads through a
    broadcast, slice or reshape count for the value behind it. `active` are fuzzy sets of which C
    computes active ones only: they read their value and points several times.
    """
    counts = [0] * len(graph)
    for root in roots:
        counts[root] = min(MANY, counts[root] + 1)
    # backwards: all users of a node come after it
    for index in range(len(graph) - 1, -1, -1):
        sets = active.get(index)
        # the value is compared with the points on both sides of each active set
        if sets is not None and counts[index]:
            counts[sets.value] = counts[sets.points] = MANY
        elif counts[index]:
            node = graph[index]
            for arg in node.args:
                uses = _uses(node, graph[arg].type, counts[index])
                counts[arg] = min(MANY, counts[arg] + uses)
    return counts


def only_units_moved(old: Type, new: Type) -> bool:
    """True if a reshape from type `old` to `new` only adds, removes or renames axes of length 1."""
    return [n for n in old.shape if n != 1] == [n for n in new.shape if n != 1]


def _uses(node: Node, operand: Type, demand: int) -> int:
    """How often an element of the operand is read by the node, whose own elements are read `demand`
    times. Any number above 1 means MANY.
    """
    match node.op:
        case ops.Broadcast():
            # each element of the operand is used this many times in the result
            return demand * (node.type.size // operand.size)
        case ops.Slice() | ops.Identity():
            return demand
        case ops.Reshape():
            return demand if only_units_moved(operand, node.type) else MANY
        case ops.Contract(axis):
            # a factor is read once for each element of the result along the axes that it lacks
            return node.type.size * operand.axes[operand.position(axis)].size // operand.size
        case ops.Window():
            return MANY  # written to the buffer, and often to two places of it
        case ops.Elementwise() | ops.Concat() | ops.Sum():
            # computed once each, however often they are used themselves: then they are kept
            return 1
        case ops.Leaf():
            return 0
        case _:
            assert_never(node.op)
