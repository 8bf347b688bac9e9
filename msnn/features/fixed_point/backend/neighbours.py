"""Finds reads of one port or memory that lie next to each other, which loops can run over."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from msnn.features.fixed_point.integers.program import IntegerNode, ReadMemory, ReadWord

_FEWEST = 8
"""Elements from which a loop is shorter than its turns written out."""


def neighbours(nodes: Sequence[IntegerNode]) -> Iterator[tuple[int, int]]:
    """First place and number of nodes that read ascending elements; 1 where they are too few."""
    begin = 0
    while begin < len(nodes):
        end = begin + 1
        while end < len(nodes) and _follows(nodes[end - 1], nodes[end]):
            end += 1
        if end - begin >= _FEWEST:
            yield begin, end - begin
        else:
            yield from ((place, 1) for place in range(begin, end))
        begin = end


def _follows(before: IntegerNode, after: IntegerNode) -> bool:
    op = before.op
    return isinstance(op, ReadWord | ReadMemory) and after.op == replace(op, index=op.index + 1)
