"""Finds the signals that values read of the log, directly or through all that they are made of."""

from __future__ import annotations

from collections.abc import Iterable

from compiler.ir.liveness import Extent, needed
from compiler.ir.ops import ReadLog, ReadSignal
from compiler.ir.program import Graph, NodeId, Program, Role


def reads(graph: Graph, wanted: Iterable[NodeId]) -> dict[str, Extent]:
    """The samples around t that the wanted values depend on, by signal."""
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
    """The signals that predictions are compared with and that no step or initial state reads."""
    compared = {signal.name for signal in program.signals if signal.role is Role.TARGET}
    compared |= {o.predicts.signal for o in program.outputs if o.predicts is not None}
    targets = [loss.target for loss in program.losses if loss.target is not None]
    compared |= reads(program.step, targets).keys()
    nodes = [output.node for output in program.outputs]
    nodes += [state.next for state in program.states]
    nodes += [loss.prediction for loss in program.losses]
    starts = reads(program.start, [state.start for state in program.states])
    return frozenset(compared - reads(program.step, nodes).keys() - starts.keys())


def span(extents: Iterable[Extent]) -> Extent | None:
    """The samples from the first to the last of all extents, None if there are none."""
    extents = tuple(extents)
    if not extents:
        return None
    return Extent(min(e.first for e in extents), max(e.last for e in extents))
