"""Narrows the bounds of integer nodes if one node is known more closely, as near a threshold."""

from __future__ import annotations

import math
from collections.abc import Sequence

from msnn.features.fixed_point.integers.program import (
    IntegerLookup,
    IntegerNode,
    Larger,
    RoundShift,
    Smaller,
    WeightedSum,
)

Interval = tuple[int, int]


def bounds_near(
    nodes: Sequence[IntegerNode], node: int, ends: Interval
) -> dict[int, tuple[float, float]]:
    """The real intervals of nodes while the word of one node lies between the two ends.

    The result contains only nodes with narrowed intervals: the nodes of which this node is a
    rescaled copy, and those computed from them.
    """
    words = {node: ends}
    # backwards first: what holds of a rescaled copy holds of the node that it was made of
    while (before := _scaled_from(nodes, node, words[node])) is not None:
        node = nodes[node].args[0]
        words[node] = before
    for index in range(node + 1, len(nodes)):
        args = nodes[index].args
        if index not in words and any(arg in words for arg in args):
            given = [words.get(arg, (nodes[arg].low, nodes[arg].high)) for arg in args]
            narrowed = _narrowed(nodes[index], given)
            if narrowed is not None:
                words[index] = narrowed
    return {
        index: (
            math.ldexp(max(low, nodes[index].low), -nodes[index].fraction),
            math.ldexp(min(high, nodes[index].high), -nodes[index].fraction),
        )
        for index, (low, high) in words.items()
    }


def _scaled_from(nodes: Sequence[IntegerNode], node: int, ends: Interval) -> Interval | None:
    """The range of words of the node that this node rescales; None if it is no rescaled copy."""
    low, high = ends
    match nodes[node].op:
        case RoundShift(bits):
            # all words that the rounded shift takes there, and half a unit more at both ends
            return (low - 1) << bits, (high + 1) << bits
        case WeightedSum(0, (factor,)) if factor > 0:
            finer = nodes[node].fraction - nodes[nodes[node].args[0]].fraction
            # floor and ceiling: an interval may only widen
            return (low // factor, -(-high // factor)) if factor == 2**finer else None
        case _:
            return None


def _narrowed(node: IntegerNode, args: Sequence[Interval]) -> Interval | None:
    """The range of words of a node for these ranges of its arguments; None if not narrowed."""
    lows, highs = [low for low, _ in args], [high for _, high in args]
    match node.op:
        case RoundShift(bits):
            # one unit at both ends covers the rounding of the shift
            return (lows[0] >> bits) - 1, (highs[0] >> bits) + 1
        case WeightedSum(constant, coefficients):
            ends = [
                sorted((c * low, c * high))
                for c, low, high in zip(coefficients, lows, highs, strict=True)
            ]
            return constant + sum(a for a, _ in ends), constant + sum(b for _, b in ends)
        case Smaller():
            return min(lows), min(highs)
        case Larger():
            return max(lows), max(highs)
        case IntegerLookup(first, bits, values):
            cell, last = ((end - first) >> bits for end in (lows[0], highs[0]))
            # entries at both ends of every cell that the interval touches
            inside = values[max(cell, 0) : max(last, 0) + 2]
            return (min(inside), max(inside)) if inside else None
        case _:
            return None
