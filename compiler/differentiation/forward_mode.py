"""Forward-mode differentiation: adds nodes with the directional derivatives (tangents) of others.

For n directions, a node y of axes (…) has the tangent ẏ of axes (directions, …): the derivative of
every element of y in each direction. The rule is ẏ = Σ ∂y/∂x ẋ over the operands x of y (Griewank,
Walther: Evaluating Derivatives, 2008, ch. 3). Tangents consist of core operations, so every backend
can compute them.

Conventions at kinks and at infinite derivatives are those of reverse mode. The tangent of a `where`
is selected like its value, so that the other branch does not contribute.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.slopes import slope_product, slope_quotient
from compiler.ir.types import Axis, Type, in_order


def tangents(
    builder: GraphBuilder,
    directions: Axis,
    seeds: Mapping[NodeId, NodeId],
    buffers: Mapping[str, str],
    infinite: Collection[str] = (),
    *,
    count: int | None = None,
) -> dict[NodeId, NodeId]:
    """The tangents, by node, of all nodes of the builder's graph that depend on the keys of
    `seeds`; `directions` is their first axis.

    `seeds` has the tangents of leaves. `buffers` maps each buffer that depends on a seed to the
    name of the buffer with the tangents of its samples; other buffers are constant. Tangents in the
    buffers `infinite` may be infinite. With `count`, only the first `count` nodes are
    differentiated. The number of added nodes is linear in the size of the graph.
    """
    found: dict[NodeId, NodeId] = dict(seeds)
    for node in range(len(builder.graph()) if count is None else count):
        # a bool has no derivative; where it switches, values have one-sided derivatives
        if node in found or builder.type(node).kind == "bool":
            continue
        with builder.at(builder.node(node).span):
            rule = _Rule(
                builder=builder,
                directions=directions,
                known=found,
                buffers=buffers,
                infinite=infinite,
                node=node,
            )
            tangent = rule.tangent()
        if tangent is not None:
            found[node] = tangent
    return found


def zero_tangent(builder: GraphBuilder, directions: Axis, node: NodeId) -> NodeId:
    """The tangent of a node that does not depend on a seed: zeros with the axes (directions, axes
    of the node).
    """
    return builder.broadcast(builder.constant(0.0), (directions, *builder.type(node).axes))


@dataclass(frozen=True)
class _Rule:
    """Derives the tangent of `node` from the tangents `known` of its operands."""

    builder: GraphBuilder
    directions: Axis
    known: Mapping[NodeId, NodeId]
    buffers: Mapping[str, str]
    infinite: Collection[str]
    node: NodeId

    def tangent(self) -> NodeId | None:
        b = self.builder
        made = b.node(self.node)
        args, op = made.args, made.op
        moving = [self.known.get(arg) for arg in args]
        if isinstance(op, ops.Window) and op.state in self.buffers:
            length = made.type.shape[-1] - 1
            # the tangents of past samples were computed when these were the newest
            samples = b.window(self.buffers[op.state], self._or_zero(args[0]), length)
            if op.state in self.infinite:
                b.infinite_values.expect(samples)
            return samples
        if all(tangent is None for tangent in moving):
            return None
        axes = (self.directions, *made.type.axes)
        match op:
            case ops.Add():
                return self._sum(*moving)
            case ops.Subtract():
                return self._sum(moving[0], self._negative(moving[1]))
            case ops.Negate():
                return self._negative(moving[0])
            case ops.Identity():
                return moving[0]
            case ops.Multiply():
                return self._sum(self._times(0, args[1]), self._times(1, args[0]))
            case ops.Divide():
                # (ṅ − y·ḋ)/d for y = n/d: one division, as y is already computed
                rest = self._negative(self._times(1, self.node))
                total = self._sum(moving[0], rest)
                if total is None:
                    return None
                quotient = slope_quotient(b, total, self._repeated(args[1]))
                # a divisor that may be 0 makes any finite tangent infinite
                if not b.infinite_values.divides(args[1]):
                    b.infinite_values.expect(quotient)
                return quotient
            case ops.Minimum():
                # as in reverse mode, a tie belongs to the first operand
                return self._chosen(b.compare(ops.Relation.LESS_EQUAL, *args), *args)
            case ops.Maximum():
                # a tie belongs to the first operand here too
                return self._chosen(b.compare(ops.Relation.GREATER_EQUAL, *args), *args)
            case ops.Clamp():
                return self._clamped()
            case ops.Select():
                return self._chosen(*args)
            case ops.Apply(function=function):
                slopes = SCALAR_FUNCTIONS[function].derivatives
                return self._sum(
                    *(
                        None if tangent is None else self._times(i, slopes[i](b, args, self.node))
                        for i, tangent in enumerate(moving)
                    )
                )
            case ops.Broadcast():
                return b.broadcast(self._or_zero(args[0]), axes)
            case ops.Reshape():
                return b.reshape(self._or_zero(args[0]), axes)
            case ops.Slice(axis=axis, start=start, stop=stop):
                return b.slice(self._or_zero(args[0]), axis, start, stop)
            case ops.Concat(axis=axis):
                return b.concat([self._or_zero(arg) for arg in args], axis)
            case ops.Sum(axis=axis):
                return b.sum(self._or_zero(args[0]), axis)
            case ops.Contract(axis=axis):
                return self._sum(
                    self._contracted(args[0], args[1], axis),
                    self._contracted(args[1], args[0], axis),
                )
            case ops.Window():
                # the caller names the buffers of all states with tangents: a missing one is a bug
                message = "the past of a buffer depends on what its newest sample depends on"
                raise AssertionError(message)
            case ops.Leaf() | ops.Compare():
                raise AssertionError("an operation without real operands has no rule")
            case _:
                assert_never(op)

    def _or_zero(self, node: NodeId) -> NodeId:
        tangent = self.known.get(node)
        return zero_tangent(self.builder, self.directions, node) if tangent is None else tangent

    def _repeated(self, value: NodeId) -> NodeId:
        """The value, equal for all directions, with the axis of the directions in front."""
        return self.builder.broadcast(value, (self.directions, *self.builder.type(value).axes))

    def _sum(self, *terms: NodeId | None) -> NodeId | None:
        total: NodeId | None = None
        for term in terms:
            if term is not None:
                total = term if total is None else self.builder.add(total, term)
        return total

    def _negative(self, tangent: NodeId | None) -> NodeId | None:
        return None if tangent is None else self.builder.negate(tangent)

    def _times(self, position: int, slope: NodeId) -> NodeId | None:
        """The tangent of the operand at `position` times `slope`, a factor that is equal in all
        directions. None if the operand depends on no seed.
        """
        tangent = self.known.get(self.builder.node(self.node).args[position])
        if tangent is None:
            return None
        product = slope_product(self.builder, tangent, self._repeated(slope))
        if self.builder.infinite_values.can_be_infinite(slope):
            # a factor 0 may follow later
            self.builder.infinite_values.expect(product)
        return product

    def _chosen(self, condition: NodeId, then: NodeId, otherwise: NodeId) -> NodeId:
        return self.builder.select(
            self._repeated(condition), self._or_zero(then), self._or_zero(otherwise)
        )

    def _clamped(self) -> NodeId:
        """The tangent of a clamp: that of the active limit, otherwise that of the clamped value."""
        b = self.builder
        value, low, high = b.node(self.node).args
        below = b.compare(ops.Relation.LESS, value, low)
        # crossed limits give the upper limit for any x; constants have no tangent
        moving = low in self.known or high in self.known
        raised = b.emit(ops.Maximum(), (value, low), b.type(value)) if moving else value
        above = self._repeated(b.compare(ops.Relation.GREATER, raised, high))
        return b.select(above, self._or_zero(high), self._chosen(below, low, value))

    def _contracted(self, moving: NodeId, other: NodeId, axis: str) -> NodeId | None:
        """The tangent of a contraction with respect to its operand `moving`: the sum over `axis` of
        its tangent times the operand `other`. None if `moving` depends on no seed.
        """
        tangent = self.known.get(moving)
        if tangent is None:
            return None
        b = self.builder
        axes = (self.directions, *b.type(self.node).axes)
        infinite = b.infinite_values
        if infinite.can_be_infinite(tangent) or infinite.can_be_infinite(other):
            # a contraction does not test its factors for 0
            along = b.type(moving).axes[b.type(moving).position(axis)]
            whole = (self.directions, *in_order((*b.type(self.node).axes, along)))
            left, right = b.broadcast(tangent, whole), b.broadcast(other, whole)
            return b.broadcast(b.sum(slope_product(b, left, right), axis), axes)
        picked = self._picked(moving, other, axis)
        product = b.contract_over(tangent, other, axis) if picked is None else picked
        return b.broadcast(product, axes)

    def _picked(self, moving: NodeId, other: NodeId, axis: str) -> NodeId | None:
        """The tangent of a contraction over `axis` with respect to a leaf p = `moving` whose seed
        is an identity matrix. ∂(Σ pᵢⱼ xⱼ)/∂pᵢⱼ is xⱼ in row i, which avoids a sum with zeros. None
        for other seeds.
        """
        b = self.builder
        # the seed is rows of an identity matrix: the sum over the axis has one nonzero term
        seed = b.node(self.known[moving])
        own = b.type(moving)
        before = _first_direction(seed.op, seed.type, own.size)
        if before is None:
            return None
        result = b.type(self.node).axes
        # the leaf's elements as directions: primed names, since the result may have the same axes
        numbers = tuple(Axis(f"{a.name}'", a.size) for a in own.axes)
        rest = tuple(a for a in b.type(other).axes if a.name != axis)
        summed = numbers[own.position(axis)]
        along = b.broadcast(other, (Axis(axis, summed.size), *rest))
        picked = b.broadcast(b.reshape(along, (summed, *rest)), (*numbers, *result))
        kept = tuple(a for a in own.axes if a.name != axis)
        if kept:
            primed = tuple(a for a in numbers if a is not summed)
            # an element of row i affects result i only: Kronecker δ over the other axes
            same = b.constant(np.eye(Type(kept).size), (*primed, *kept), unit=None)
            picked = b.multiply(picked, b.broadcast(same, (*numbers, *result)))

        def zeros(length: int) -> NodeId | None:
            axes = (Axis(self.directions.name, length), *result)
            return b.broadcast(b.constant(0.0, unit=None), axes) if length else None

        # zeros for the directions of other leaves, before and after
        middle = b.reshape(picked, (Axis(self.directions.name, own.size), *result))
        after = self.directions.size - before - own.size
        present = [part for part in (zeros(before), middle, zeros(after)) if part is not None]
        return b.concat(present, self.directions.name) if len(present) > 1 else present[0]


def _first_direction(seed: ops.Op, type: Type, count: int) -> int | None:
    """If the seed of a leaf with `count` elements is a constant that gives each element a unit
    direction of its own, in order: the index of the first direction. None for any other seed.
    `type` is the type of the seed.
    """
    if not isinstance(seed, ops.Constant):
        return None
    # only the seeds that `sensitivities` makes are recognised; others use the general sum
    values = np.reshape(seed.values, (type.shape[0], count))
    rows = np.flatnonzero(values.any(axis=1))
    if len(rows) != count or not np.array_equal(values[rows], np.eye(count)):
        return None
    first = int(rows[0])
    return first if int(rows[-1]) == first + count - 1 else None
