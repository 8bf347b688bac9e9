"""Sums over a shifted buffer that shift it in the same loop, reading each sample once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from backends.c_language.places import Index
from backends.c_language.scope import BlockScope, LocalName
from backends.c_language.tree import Binary, Expression, Real
from backends.c_lowering.state_memory import ShiftBuffer, StateMemory
from backends.c_lowering.sums import in_blocks
from compiler.ir.nodes import needed
from compiler.ir.ops import ReadState, Reduction, Window
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import WINDOW

Term = Callable[[Index, Expression, BlockScope], Expression]


def shifting_sums(
    graph: Graph, roots: Sequence[NodeId], states: Iterable[StateMemory], unroll: int
) -> dict[NodeId, ShiftBuffer]:
    """Sums that are the only reader of a scalar buffer's window longer than `unroll`."""
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
    """Writes the loop; `term` returns the contribution of a sample at an index of the window."""
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
