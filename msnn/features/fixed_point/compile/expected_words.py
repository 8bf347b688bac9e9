"""Turns the range of an equation into limits of the words that can leave it."""

from __future__ import annotations

import math

from compiler.ir.program import Expected
from msnn.features.fixed_point.compile.lowering.lower_graph import Lowering
from msnn.features.fixed_point.integers.program import ExpectedWords


def expected_words(entry: Expected, step: Lowering) -> ExpectedWords:
    """The elements that can leave the range; rounding alone is no reason to say so."""
    low, high = entry.range
    found = [(node, step.builder[node]) for node in step.nodes(entry.node)]
    # limits are rounded outwards, so that a value on the limit is within it at any scale
    limits = {
        node: (math.floor(math.ldexp(low, n.fraction)), math.ceil(math.ldexp(high, n.fraction)))
        for node, n in found
    }
    # proved bounds within the limits need no check in the step
    outside = [i for i, n in found if n.low < limits[i][0] or n.high > limits[i][1]]
    return ExpectedWords(
        name=entry.name,
        nodes=tuple(outside),
        low=tuple(limits[node][0] for node in outside),
        high=tuple(limits[node][1] for node in outside),
    )
