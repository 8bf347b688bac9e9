"""Finds reads of adjacent memory, and rows of matrix products, that are shorter as a loop."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from msnn.features.fixed_point.integers.program import (
    IntegerNode,
    ReadMemory,
    ReadWord,
    WeightedSum,
)

_FEWEST_READS = 8
"""Minimum number of elements for which a loop is shorter than separate statements."""

_TERM, _COEFFICIENT, _LOOP = 8, 2, 64
"""Bytes of code on Cortex-M0 (gcc 12 -Os) of a written-out term, of a coefficient in a table and,
roughly, of two loops."""

_FEWEST_TERMS = 4
"""Minimum number of terms of a row; shorter sums are one expression."""


def neighbours(nodes: Sequence[IntegerNode]) -> Iterator[tuple[int, int]]:
    """First index and length of each group of nodes that read ascending elements.

    Groups that are too short for a loop are split into single nodes.
    """
    begin = 0
    while begin < len(nodes):
        end = begin + 1
        while end < len(nodes) and _follows(nodes[end - 1], nodes[end]):
            end += 1
        if end - begin >= _FEWEST_READS:
            yield begin, end - begin
        else:
            yield from ((place, 1) for place in range(begin, end))
        begin = end


def _follows(before: IntegerNode, after: IntegerNode) -> bool:
    op = before.op
    return isinstance(op, ReadWord | ReadMemory) and after.op == replace(op, index=op.index + 1)


def matrix_products(nodes: Sequence[IntegerNode], largest_word: int) -> dict[int, tuple[int, ...]]:
    """All rows of each matrix product in their order, by the index of its first row.

    All rows have the same operands in the same order, so all can be computed at the first row.
    """
    rows: dict[tuple[int, ...], list[int]] = {}
    for index, node in enumerate(nodes):
        op = node.op
        if isinstance(op, WeightedSum) and len(node.args) >= _FEWEST_TERMS:
            in_words = all(abs(coefficient) <= largest_word for coefficient in op.coefficients)
            if in_words and all(_is_word(nodes[arg], largest_word) for arg in node.args):
                rows.setdefault(node.args, []).append(index)
    return {
        found[0]: tuple(found) for args, found in rows.items() if _is_shorter(len(found), len(args))
    }


def _is_word(node: IntegerNode, largest_word: int) -> bool:
    return -largest_word <= node.low and node.high <= largest_word


def _is_shorter(rows: int, terms: int) -> bool:
    """True if a loop takes less code. Copying an operand to an array costs about one term."""
    as_loop = _LOOP + terms * _TERM + rows * terms * _COEFFICIENT
    return rows > 1 and as_loop < rows * terms * _TERM
