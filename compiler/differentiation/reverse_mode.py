"""Reverse-mode differentiation: adds nodes with the gradients of a scalar with respect to other
nodes.

For a scalar S with known adjoints ∂S/∂y, a node x has the adjoint x̄ = Σ ūᵀ ∂u/∂x over its uses u
(Griewank, Walther: Evaluating Derivatives, 2008, ch. 3). The gradient consists of core operations,
so that every backend can compute it.

All backends share the conventions at kinks. abs, sign and relu have derivative 0 at 0. A tie of min
or max goes to the first operand, and clamp has derivative 1 on its bounds. Fuzzy sets use the
right-hand derivative. A derivative is the sum over all paths of the product of local derivatives. A
product with a factor 0 is 0, even if another factor is infinite: `sqrt(max(x, 0))` has derivative 0
below 0. If no factor is 0 and one is infinite, it is ±∞ (`slope_product`). The pass `guard_untaken`
runs before, so that the other branch of a `where` contributes 0, as in `where(x > 0, sqrt(x), 0)`
at 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar, assert_never

import numpy as np

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node
from compiler.ir.ops import Reshape
from compiler.ir.program import NodeId
from compiler.ir.rules import quotient_unit
from compiler.ir.scalars import SCALAR_FUNCTIONS, Array
from compiler.ir.slopes import divisor_slope, slope_product, slope_quotient
from compiler.ir.types import WINDOW, Axis, in_order
from compiler.passes.guard_derivatives import guarded

Key = TypeVar("Key")


def gradients(
    builder: GraphBuilder, adjoints: Mapping[NodeId, NodeId], wanted: Sequence[NodeId]
) -> list[NodeId | None]:
    """∂S/∂w of a scalar S for each wanted node w, in order, given ∂S/∂y (in the axes of y) for the
    keys y of `adjoints`.

    None if S does not depend on w. The nodes are added to the builder; their number is linear in
    the size of the graph. Bool nodes have no gradient.
    """
    last = max(adjoints, default=-1)
    needed = _depending_on(builder, wanted, last)
    found: dict[NodeId, NodeId] = dict(adjoints)
    # users have larger ids, so an adjoint is complete when its node is reached
    for node in range(last, -1, -1):
        adjoint = found.get(node)
        if adjoint is None or node not in needed:
            continue
        rule = _Rule(builder, node, adjoint)
        with builder.at(builder.node(node).span):
            for position, share in rule.shares(needed):
                argument = builder.node(node).args[position]
                before = found.get(argument)
                # an operand that is used twice, as in x·x, accumulates here
                found[argument] = share if before is None else builder.add(before, share)
    return [found.get(node) for node in wanted]


@dataclass(frozen=True)
class StepGradients:
    """The nodes of the gradients ∂S/∂x of a scalar S for the states, parameters and signals x that
    a step reads, by name.

    A name is absent if S does not depend on it.
    """

    states: Mapping[str, NodeId]
    parameters: Mapping[str, NodeId]
    signals: Mapping[str, NodeId]
    """The gradients by signals; empty if not requested."""


def step_gradients(
    builder: GraphBuilder, adjoints: Mapping[NodeId, NodeId], *, signals: bool = True
) -> StepGradients:
    """The gradients of a scalar S with respect to all states and parameters that a step reads, and
    with `signals` also to its signals. `adjoints` has ∂S/∂y by node y.

    A buffer state is read whole (`ReadState`), or together with its newest sample (`Window`).
    `signals` requires a graph that reads each signal once, as step form does; window form reads a
    signal over several windows.
    """
    last = max(adjoints, default=-1)
    kinds = ops.ReadState | ops.Window | ops.ReadParameter
    readers = [
        node
        for node in range(last + 1)
        if isinstance(builder.node(node).op, kinds | ops.ReadSignal if signals else kinds)
    ]
    states: dict[str, NodeId] = {}
    parameters: dict[str, NodeId] = {}
    inputs: dict[str, NodeId] = {}
    for node, gradient in zip(readers, gradients(builder, adjoints, readers), strict=True):
        if gradient is None:
            continue
        match builder.node(node).op:
            case ops.ReadState(name=name):
                accumulate(builder, states, name, gradient)
            case ops.Window(state=name):
                # the newest sample is an operand of the Window; the state is the rest
                past = builder.type(gradient).axes[-1].size - 1
                accumulate(builder, states, name, builder.slice(gradient, WINDOW, 0, past))
            case ops.ReadParameter(name=name):
                accumulate(builder, parameters, name, gradient)
            case ops.ReadSignal(signal=name):
                accumulate(builder, inputs, name, gradient)
            case _:
                raise AssertionError("the readers are filtered above")
    return StepGradients(states, parameters, inputs)


def accumulate(builder: GraphBuilder, sums: dict[Key, NodeId], key: Key, addend: NodeId) -> None:
    """Adds the node `addend` to the sum stored at `key`, or stores it if there is none yet."""
    before = sums.get(key)
    sums[key] = addend if before is None else builder.add(before, addend)


def _depending_on(builder: GraphBuilder, wanted: Iterable[NodeId], last: NodeId) -> set[NodeId]:
    """The nodes up to the id `last` that depend on a wanted node, and the wanted nodes
    themselves.
    """
    needed = set(wanted)
    for node in range(min(needed, default=0), last + 1):
        if builder.type(node).kind == "real" and any(
            argument in needed for argument in builder.node(node).args
        ):
            needed.add(node)
    return needed


@dataclass(frozen=True)
class _Rule:
    """Propagates the adjoint of one node to its operands."""

    builder: GraphBuilder
    node: NodeId
    adjoint: NodeId

    def shares(self, needed: set[NodeId]) -> list[tuple[int, NodeId]]:
        """The terms that the node adds to the adjoints of those of its operands that are in
        `needed`: pairs (position of the operand, node of the term).
        """
        args = self.builder.node(self.node).args
        wanted = [position for position, argument in enumerate(args) if argument in needed]
        return [(position, self._share(position)) for position in wanted]

    def _share(self, position: int) -> NodeId:
        b, g = self.builder, self.adjoint
        node = b.node(self.node)
        args = node.args
        match node.op:
            case ops.Add():
                return g
            case ops.Subtract():
                return g if position == 0 else b.negate(g)
            case ops.Negate():
                return b.negate(g)
            case ops.Identity():
                return g
            case ops.Multiply():
                return self._times(args[1 - position])
            case ops.Divide():
                if position == 0:
                    return slope_quotient(b, g, args[1])
                # −g·y/d for y = n/d: y is already computed
                return divisor_slope(b, g, args[1], self.node)
            case ops.Minimum():
                # <= and >=: a tie of min or max goes to the first operand
                first = b.compare(ops.Relation.LESS_EQUAL, args[0], args[1])
                return self._chosen(first, position == 0)
            case ops.Maximum():
                first = b.compare(ops.Relation.GREATER_EQUAL, args[0], args[1])
                return self._chosen(first, position == 0)
            case ops.Clamp():
                return self._clamp_share(position)
            case ops.Select():
                return self._chosen(args[0], position == 1)
            case ops.Apply(function=function):
                derivative = SCALAR_FUNCTIONS[function].derivatives[position]
                return self._times(derivative(b, args, self.node))
            case ops.Broadcast():
                # a repeated element accumulates the adjoints of all copies
                return self._summed_to(b.type(args[0]).axes, g)
            case ops.Reshape():
                return b.reshape(g, b.type(args[0]).axes)
            case ops.Slice(axis=axis, start=start, stop=stop):
                return self._padded(axis, start, stop)
            case ops.Concat(axis=axis):
                start = sum(self._length(argument, axis) for argument in args[:position])
                return b.slice(g, axis, start, start + self._length(args[position], axis))
            case ops.Sum():
                return b.broadcast(g, b.type(args[0]).axes)
            case ops.Contract():
                return self._contracted(position)
            # the past samples are a state, whose adjoint `step_gradients` returns
            case ops.Window():
                # the newest sample is the last one of the window
                length = self._length(self.node, WINDOW)
                return b.element(g, WINDOW, length - 1)
            case ops.Leaf() | ops.Compare():
                raise AssertionError("an operation without real operands has no shares")
            case _:
                assert_never(node.op)

    def _times(self, slope: NodeId) -> NodeId:
        """The adjoint times the local derivative `slope`; only the derivative if the adjoint is the
        constant 1.
        """
        b = self.builder
        seed = b.node(self.adjoint)
        if isinstance(seed.op, ops.Broadcast):
            seed = b.node(seed.args[0])
        # 1·slope equals the slope to the bit; the product would only add nodes
        if seed.op == ops.Constant((1.0,)) and b.type(slope).axes == b.type(self.adjoint).axes:
            return slope
        return slope_product(b, self.adjoint, slope)

    def _chosen(self, condition: NodeId, when: bool) -> NodeId:
        """The adjoint where the bool node `condition` has the value `when`, 0 elsewhere."""
        zero = self._zero()
        then, otherwise = (self.adjoint, zero) if when else (zero, self.adjoint)
        return self.builder.select(condition, then, otherwise)

    def _zero(self) -> NodeId:
        b = self.builder
        return b.broadcast(b.constant(0.0), b.type(self.adjoint).axes)

    def _clamp_share(self, position: int) -> NodeId:
        b = self.builder
        x, low, high = b.node(self.node).args
        # on a bound the derivative belongs to x; crossed limits give the upper limit for any x
        match position:
            case 0:
                above = self._chosen(b.compare(ops.Relation.LESS_EQUAL, low, x), when=True)
                return b.select(b.compare(ops.Relation.LESS_EQUAL, x, high), above, self._zero())
            case 1:
                share = self._chosen(b.compare(ops.Relation.LESS, x, low), when=True)
                return b.select(b.compare(ops.Relation.LESS_EQUAL, low, high), share, self._zero())
            case _:
                raised = b.emit(ops.Maximum(), (x, low), b.type(x))
                return self._chosen(b.compare(ops.Relation.GREATER, raised, high), when=True)

    def _length(self, node: NodeId, axis: str) -> int:
        found = self.builder.type(node).axis(axis)
        assert found is not None
        return found.size

    def _summed_to(self, axes: tuple[Axis, ...], value: NodeId) -> NodeId:
        """The value summed over the axes that are not in `axes`, with the remaining ones in that
        order.
        """
        b = self.builder
        kept = {axis.name for axis in axes}
        for axis in reversed(b.type(value).axes):
            if axis.name not in kept:
                value = b.sum(value, axis.name)
        return b.broadcast(value, axes)

    def _padded(self, axis: str, start: int, stop: int) -> NodeId:
        """The adjoint of the operand of a slice start … stop−1 along `axis`: the slice's adjoint at
        its position, zeros around it.
        """
        b = self.builder
        source = b.node(self.node).args[0]
        parts = [
            self._zeros_along(axis, start),
            self.adjoint,
            self._zeros_along(axis, self._length(source, axis) - stop),
        ]
        present = [part for part in parts if part is not None]
        return b.concat(present, axis) if len(present) > 1 else present[0]

    def _zeros_along(self, axis: str, length: int) -> NodeId | None:
        if length == 0:
            return None
        b = self.builder
        axes = b.type(self.adjoint).axes
        sized = tuple(Axis(axis, length) if a.name == axis else a for a in axes)
        return b.broadcast(b.constant(0.0), sized)

    def _contracted(self, position: int) -> NodeId:
        """The term for the operand of a contraction at `position`: the adjoint times the other
        operand, summed over the axes that this operand lacks.
        """
        b = self.builder
        args = b.node(self.node).args
        wanted, other = b.type(args[position]).axes, args[1 - position]
        kept = {axis.name for axis in wanted}
        shared = [a for a in b.type(other).axes if b.type(self.adjoint).axis(a.name) is not None]
        summed = [axis.name for axis in shared if axis.name not in kept]
        # each element of this operand has one partner in the other: there is no sum
        if not summed:
            left, right = self._in_axes(self.adjoint, wanted), self._in_axes(other, wanted)
            return slope_product(b, left, right)
        infinite = b.infinite_values
        if infinite.can_be_infinite(self.adjoint) or infinite.can_be_infinite(other):
            # a contraction does not test its factors for 0
            return self._summed_to(wanted, slope_product(b, *self._in_all_axes(other)))
        # the contraction sums one axis, the others are summed afterwards
        product = b.contract_over(self.adjoint, other, summed[-1])
        return self._summed_to(wanted, product)

    def _in_all_axes(self, other: NodeId) -> tuple[NodeId, NodeId]:
        """The adjoint and the operand `other`, each repeated along the axes that only the other one
        has.
        """
        b = self.builder
        mine, others = b.type(self.adjoint), b.type(other).axes
        more = tuple(axis for axis in others if mine.axis(axis.name) is None)
        axes = in_order((*mine.axes, *more))
        return b.broadcast(self.adjoint, axes), b.broadcast(other, axes)

    def _in_axes(self, value: NodeId, axes: tuple[Axis, ...]) -> NodeId:
        return self.builder.broadcast(self._summed_to_present(value, axes), axes)

    def _summed_to_present(self, value: NodeId, axes: tuple[Axis, ...]) -> NodeId:
        names = {axis.name for axis in axes}
        present = tuple(axis for axis in self.builder.type(value).axes if axis.name in names)
        return self._summed_to(present, value)


def gradient_nodes(
    builder: GraphBuilder, value: NodeId, wanted: Sequence[NodeId]
) -> list[NodeId | None]:
    """For each wanted node w, the node of Σ ∂v/∂w over all elements v of the node `value`; None if
    it does not depend on w.

    A gradient has the axes of w and the unit of value / w. Only the nodes that the value depends on
    are differentiated; untaken branches are guarded first. Nodes already in the graph are reused.
    """
    return _Differentiated(builder, value).gradients(np.ones(()), wanted)


def element_gradients(
    builder: GraphBuilder, value: NodeId, wanted: Sequence[NodeId]
) -> list[list[NodeId | None]]:
    """The rows of a Jacobian: for each element v of the node `value`, in C order, a list with the
    node of ∂v/∂w for each wanted node w.

    None if an element does not depend on w.
    """
    differentiated = _Differentiated(builder, value)
    # one row for each element: weight 1 for it, 0 for all others
    rows = np.eye(builder.type(value).size)
    return [differentiated.gradients(row, wanted) for row in rows]


class _Differentiated:
    """A copy of the graph of `value` with guarded branches, in which gradients are computed. The
    nodes of the results are copied back to `builder`.
    """

    def __init__(self, builder: GraphBuilder, value: NodeId) -> None:
        self._builder = builder
        self._value = value
        self._draft, self._guarded = guarded(builder.graph(), [value])
        # shared by all rows of a Jacobian: common nodes are copied once
        self._copies: dict[NodeId, NodeId] = {}

    def gradients(self, weights: Array, wanted: Sequence[NodeId]) -> list[NodeId | None]:
        """For each wanted node w, the node of Σ weight · ∂v/∂w over the elements v of the value;
        None if it does not depend on w. `weights` has one weight per element, or a scalar for all.
        """
        draft, type = self._draft, self._builder.type(self._value)
        if weights.ndim == 0:
            adjoint = draft.broadcast(draft.constant(weights), type.axes)
        else:
            adjoint = draft.constant(weights, type.axes)
        # the value does not depend on other nodes
        present = [node for node in wanted if node in self._guarded]
        inner = [self._guarded[node] for node in present]
        found = gradients(draft, {self._guarded[self._value]: adjoint}, inner)
        slopes = dict(zip(present, found, strict=True))
        results: list[NodeId | None] = []
        for node in wanted:
            slope = slopes.get(node)
            results.append(None if slope is None else self._result(slope, node))
        return results

    def _result(self, slope: NodeId, node: NodeId) -> NodeId:
        builder = self._builder
        self._copy(slope)
        copied = self._copies[slope]
        # derivative rules leave some units unknown; the unit of the result is known
        unit = quotient_unit(builder.type(self._value).unit, builder.type(node).unit)
        type = builder.type(copied)
        if unit is None or type.unit == unit:
            return copied
        return builder.emit(Reshape(), (copied,), type.with_unit(unit))

    # an explicit stack: graphs are deeper than Python's recursion limit
    def _copy(self, wanted: NodeId) -> None:
        waiting = [wanted]
        while waiting:
            index = waiting[-1]
            node = self._draft.node(index)
            missing = [arg for arg in node.args if arg not in self._copies]
            if index in self._copies or not missing:
                waiting.pop()
            if index not in self._copies and not missing:
                args = tuple(self._copies[arg] for arg in node.args)
                self._copies[index] = copy_node(self._builder, node, args)
            waiting += missing
