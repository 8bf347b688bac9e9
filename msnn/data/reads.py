"""Finds the recorded signals that values depend on, directly or through other nodes."""

from __future__ import annotations

from collections.abc import Iterable

from compiler.ir.nodes import Extent, needed
from compiler.ir.ops import ReadLog, ReadSignal
from compiler.ir.program import Graph, NodeId, Program, Role, Signal


def reads(graph: Graph, wanted: Iterable[NodeId]) -> dict[str, Extent]:
    """The samples relative to t that the nodes depend on, by signal."""
    marked = needed(graph, wanted)
    found: dict[str, Extent] = {}
    for index, node in graph:
        if not marked[index]:
            continue
        match node.op:
            # in window form both are samples of the log; closing loops takes ReadSignal away
            case ReadLog(signal, first, last) | ReadSignal(signal, first, last):
                extent = Extent(first, last)
                found[signal] = found[signal].union(extent) if signal in found else extent
            case _:
                pass
    return found


def compared_signals(program: Program) -> frozenset[str]:
    """Signals that predictions are compared with, one row at a time, and all targets."""
    targets = {signal.name for signal in program.signals if signal.role is Role.TARGET}
    compared = {o.predicts.signal for o in program.outputs if o.predicts is not None} | targets
    return frozenset(compared.union(*_sides(program)))


def signals_only_compared(program: Program) -> frozenset[str]:
    """The `compared_signals` that no step reads; only their measured values are needed.

    A loss that reads several rows of a signal, e.g. for a derivative, needs interpolated values
    too, and so does an initial state. A target may be read at one row only.
    """
    targets = {signal.name for signal in program.signals if signal.role is Role.TARGET}
    nodes = [output.node for output in program.outputs]
    nodes += [state.next for state in program.states]
    nodes += [loss.prediction for loss in program.losses]
    starts = reads(program.start, [state.start for state in program.states])
    needed = reads(program.step, nodes).keys() | (starts.keys() - targets)
    sides = (*_sides(program), starts)
    needed |= {n for side in sides for n, at in side.items() if at.first != at.last}
    return compared_signals(program) - needed


def measured_beside(whole: Program, program: Program) -> tuple[Signal, ...]:
    """The signals that outputs of `whole` predict and that a part of it, `program`, does not
    read.
    """
    read = {signal.name for signal in program.signals}
    predicted = {out.predicts.signal for out in whole.outputs if out.predicts is not None}
    return tuple(s for s in whole.signals if s.name in predicted - read)


def _sides(program: Program) -> list[dict[str, Extent]]:
    """The samples relative to t that the target of each loss reads."""
    return [
        reads(program.step, [loss.target]) for loss in program.losses if loss.target is not None
    ]


def span(extents: Iterable[Extent]) -> Extent | None:
    """The smallest extent that contains all extents; None if there are none."""
    extents = tuple(extents)
    if not extents:
        return None
    return Extent(min(e.first for e in extents), max(e.last for e in extents))
