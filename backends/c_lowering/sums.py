"""Writes sums along an axis, first term first: the order of all backends with exact bits."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from backends.c_language.functions import scalar_operation
from backends.c_language.places import Index
from backends.c_language.scope import BlockScope, LocalName
from backends.c_language.tree import Binary, Expression, Name, Real
from backends.c_lowering.state_memory import ShiftBuffer, StateMemory
from backends.c_lowering.values import Computed, Indices, LocalValues, Value, depth_of, element_of
from compiler.ir.nodes import needed
from compiler.ir.ops import Add, Multiply, ReadState, Reduction, Window
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import WINDOW, Type

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
    """The C value of `node`: the sum over `axis` of one factor or of the product of two. `factors`
    are values with their types, `locals` names the local variables. With `active`, only terms with
    these indices are added, since all others are 0.
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
        """Writes `width` partial sums, each of every width-th term, and adds them at the end. A
        processor computes them in parallel.
        """
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
    """Writes `body(index, scope)` for the indices 0 … count−1: a loop with `block` of them per
    iteration, then the remaining ones without a loop.
    """
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


Term = Callable[[Index, Expression, BlockScope], Expression]


def shifting_sums(
    graph: Graph, roots: Sequence[NodeId], states: Iterable[StateMemory], unroll: int
) -> dict[NodeId, ShiftBuffer]:
    """The sums that shift a buffer while they read it, with this buffer. Such a sum is the only
    reader of the window of a scalar buffer of at least `unroll` samples. `roots` are the nodes
    whose values are needed, `states` the memory of all states.
    """
    live = needed(graph, roots)
    buffers = {
        memory.state.name: memory
        for memory in states
        if isinstance(memory, ShiftBuffer)
        and len(memory.shape) == 1
        and memory.shape[0] >= max(unroll, 2)
    }
    following = {memory.state.next: name for name, memory in buffers.items()}
    readers: dict[str, list[NodeId | None]] = {name: [] for name in buffers}
    for root in roots:
        op = graph[root].op
        if isinstance(op, Window) and op.state in buffers:
            readers[op.state].append(None)
        # two states with the same next value: the shifted samples have another reader
        if roots.count(root) > 1 and root in following:
            readers[following[root]].append(None)
    for index, node in graph:
        if live[index]:
            if isinstance(node.op, ReadState) and node.op.name in buffers:
                readers[node.op.name].append(None)
            for arg in node.args:
                op = graph[arg].op
                if arg in following:
                    readers[following[arg]].append(None)
                elif isinstance(op, Window) and op.state in buffers and index not in following:
                    readers[op.state].append(index)
    found: dict[NodeId, ShiftBuffer] = {}
    for name, memory in buffers.items():
        match readers[name]:
            # exactly one reader, and one buffer per sum, since it has one loop
            case [int(reader)] if reader not in found and _sums_window(graph[reader]):
                found[reader] = memory
            case _:
                pass
    return found


def _sums_window(node: Node) -> bool:
    along = isinstance(node.op, Reduction) and node.op.axis == WINDOW
    return along and node.type.size == 1


def write_moving_sum(
    memory: ShiftBuffer,
    newest: Expression,
    total: LocalName,
    term: Term,
    block: int,
    scope: BlockScope,
) -> Expression:
    """Writes a loop that sums over the window of a buffer and shifts its samples by one; returns
    the sum, a variable called `total`. `newest` is the newest sample; `term(index, sample, scope)`
    gives the term of a sample. An iteration handles `block` terms.
    """
    samples, kept = memory.samples, memory.shape[-1]
    # −0 + x is x for every x, but +0 + −0 is +0
    sum = scope.variable(total, Real(-0.0))
    sample = scope.variable(f"{sum.text}_sample", samples.element((Index(),)))

    def move(along: Index, following: Expression, inner: BlockScope) -> None:
        inner.assign(sum, Binary("+", sum, term(along, sample, inner)))
        inner.assign(sample, following)
        inner.assign(samples.element((along,)), sample)

    def move_kept(along: Index, inner: BlockScope) -> None:
        move(along, samples.element((along.plus(Index(1)),)), inner)

    # all samples move by one; the window has one sample more than the buffer
    in_blocks(kept - 1, block, scope, move_kept)
    move(Index(kept - 1), newest, scope)
    scope.assign(sum, Binary("+", sum, term(Index(kept), sample, scope)))
    return sum
