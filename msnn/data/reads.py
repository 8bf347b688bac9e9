"""Finds what values read of the log, directly or through all that they are made of."""

from __future__ import annotations

from collections.abc import Iterable

from compiler.ir.liveness import Extent, needed
from compiler.ir.ops import ReadLog, ReadSignal
from compiler.ir.program import Graph, NodeId


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


def span(extents: Iterable[Extent]) -> Extent | None:
    """The samples from the first to the last of all extents, None if there are none."""
    extents = tuple(extents)
    if not extents:
        return None
    return Extent(min(e.first for e in extents), max(e.last for e in extents))
