"""Writes sums along an axis, first term first: the order of all backends with exact bits."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from backends.c_language.operations import scalar_operation
from backends.c_language.places import Index
from backends.c_language.scope import BlockScope
from backends.c_language.tree import Expression, Name, Real
from backends.c_lowering.local_values import LocalValues
from backends.c_lowering.values import Computed, Indices, Value, depth_of, element_of
from compiler.ir.ops import Add, Multiply
from compiler.ir.program import Node
from compiler.ir.types import Type

_SHORT = 3
"""Maximum number of terms of a sum that is written as one expression."""

_NEUTRAL = Real(-0.0)
"""Initial value of a sum: −0.0 + x is x for every x, but 0.0 + −0.0 is 0.0."""


def sum_along(
    node: Node,
    axis: str,
    factors: Sequence[tuple[Value, Type]],
    locals: LocalValues,
    active: Sequence[Index] = (),
) -> Computed:
    """Σ over the axis of the product of one or two factors; only over the `active` terms, if
    any.
    """
    # the verifier ensures that all factors have the summed axis with equal size
    first = factors[0][1]
    count = first.axes[first.position(axis)].size
    names = node.type.axis_names

    def term(indices: Indices, along: Index, scope: BlockScope) -> Expression:
        where = dict(zip(names, indices, strict=True)) | {axis: along}
        elements = tuple(
            element_of(value, [where[name] for name in type.axis_names], scope)
            for value, type in factors
        )
        # a plain sum has one factor
        if len(elements) == 1:
            return elements[0]
        return scalar_operation(Multiply(), elements, locals.functions)

    def added(total: Expression, indices: Indices, along: Index, scope: BlockScope) -> Expression:
        return scalar_operation(Add(), (total, term(indices, along, scope)), locals.functions)

    def make(indices: Indices, scope: BlockScope) -> Expression:
        if active or count <= _SHORT:
            first, *rest = active or [Index(along) for along in range(count)]
            total = term(indices, first, scope)
            for along in rest:
                total = added(total, indices, along, scope)
            return total
        return _written_out(indices, scope) if count <= locals.unroll else _loop(indices, scope)

    def _written_out(indices: Indices, scope: BlockScope) -> Expression:
        # starts with the first term, so no initial value is needed
        total = _variable(term(indices, Index(), scope), scope)
        for along in range(1, count):
            scope.assign(total, added(total, indices, Index(along), scope))
        return total

    def _loop(indices: Indices, scope: BlockScope) -> Expression:
        width = locals.parallel_sums
        # partial sums need at least two terms each to pay off
        if width > 1 and count >= 2 * width:
            return _side_by_side(width, indices, scope)
        total = _variable(_NEUTRAL, scope)

        def add_term(along: Index, inner: BlockScope) -> None:
            inner.assign(total, added(total, indices, along, inner))

        in_blocks(count, locals.block, scope, add_term)
        return total

    def _side_by_side(width: int, indices: Indices, scope: BlockScope) -> Expression:
        """Sums of every width-th term, added at the end: a processor works on all at once."""
        totals = [_variable(_NEUTRAL, scope) for _ in range(width)]
        with scope.loop(count // width) as (along, inner):
            for lane, total in enumerate(totals):
                place = along.times(width).plus(Index(lane))
                inner.assign(total, added(total, indices, place, inner))
        # element k always belongs to partial sum k mod width
        for lane in range(count % width):
            place = Index(count - count % width + lane)
            scope.assign(totals[lane], added(totals[lane], indices, place, scope))
        result: Expression = totals[0]
        for total in totals[1:]:
            result = scalar_operation(Add(), (result, total), locals.functions)
        return result

    def _variable(begin: Expression, scope: BlockScope) -> Name:
        locals.notes.write(node, scope)
        return scope.variable(locals.name(node, "sum"), begin)

    def finish(value: Expression, scope: BlockScope) -> Expression:
        return locals.finished(node, value, scope)

    return Computed(node.type.shape, make, 1 + max(depth_of(value) for value, _ in factors), finish)


def in_blocks(
    count: int, block: int, scope: BlockScope, body: Callable[[Index, BlockScope], None]
) -> None:
    """Writes `body` for 0 … count−1: a loop with `block` steps per iteration, then the rest."""
    # no loop for a single iteration
    if block <= 1 or count < 2 * block:
        with scope.loop(count) as (along, inner):
            body(along, inner)
        return
    whole = count - count % block
    with scope.loop(whole, block) as (along, inner):
        for offset in range(block):
            body(along.plus(Index(offset)), inner)
    for index in range(whole, count):
        body(Index(index), scope)
