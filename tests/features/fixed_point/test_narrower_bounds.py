"""Slopes and bounds beside thresholds contain all that words and numbers there do."""

import math

import numpy as np
import pytest

from compiler.ir.scalars import SCALAR_FUNCTIONS
from msnn.features.fixed_point.compile.tables import steepest
from msnn.features.fixed_point.compile.thresholds import bounds_near
from msnn.features.fixed_point.integers.interpret import evaluated
from msnn.features.fixed_point.integers.program import (
    IntegerLookup,
    IntegerNode,
    IntegerOp,
    Larger,
    ReadWord,
    RoundShift,
    Smaller,
    WeightedSum,
)

# below 0, above it, around it, and where tan, log, √ and 1/x are finite
_INTERVALS = ((-1.2, -0.3), (0.2, 0.9), (-0.9, 0.4), (1.1, 3.0), (-4.0, 2.0))


@pytest.mark.parametrize(
    "function",
    [
        "exp",
        "log",
        "sqrt",
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "sinh",
        "cosh",
        "tanh",
        "sigmoid",
        "softplus",
    ],
)
@pytest.mark.parametrize("ends", _INTERVALS)
def test_no_two_points_are_further_apart_than_the_steepest_slope_says(
    function: str, ends: tuple[float, float]
) -> None:
    points = np.linspace(*ends, 4001)
    with np.errstate(invalid="ignore"):
        values = SCALAR_FUNCTIONS[function].numpy(points)
    found = np.abs(np.diff(values) / np.diff(points))
    slope = steepest(function, *ends)
    # of differences of neighbours the last digits are rounding
    assert not np.any(found > slope * (1.0 + 1e-9) + 1e-9)
    if math.isfinite(slope):
        assert np.all(np.isfinite(values))


def _node(op: IntegerOp, *args: int) -> IntegerNode:
    return IntegerNode(op=op, args=args, fraction=0, low=-(2**20), high=2**20)


_TABLE = IntegerLookup(-64, 4, (5, -3, 40, 7, 90, -20, 1, 30, 8), "f")
_NODES = (
    _node(ReadWord("u", 0)),
    _node(RoundShift(3), 0),
    _node(ReadWord("v", 0)),
    _node(Smaller(), 1, 2),
    _node(Larger(), 1, 2),
    _node(WeightedSum(7, (3, -5)), 1, 3),
    _node(_TABLE, 1),
    _node(RoundShift(2), 5),
)
_LIMITED = {2: (-6, 9)}


def test_words_beside_a_threshold_are_within_the_bounds_of_there() -> None:
    low, high = _LIMITED[2]
    nodes = tuple(
        IntegerNode(op=node.op, args=node.args, fraction=0, low=low, high=high)
        if index == 2
        else node
        for index, node in enumerate(_NODES)
    )
    for ends in ((-3, 2), (4, 4), (-20, -19), (10, 30)):
        near = bounds_near(nodes, 1, ends)
        seen: dict[int, list[int]] = {index: [] for index in near}
        for u in range(-500, 500):
            for v in range(low, high + 1):
                values = evaluated(nodes, {"u": [u], "v": [v]}, {})
                if ends[0] <= values[1] <= ends[1]:
                    for index, words in seen.items():
                        words.append(values[index])
        assert set(near) == {0, 1, 3, 4, 5, 6, 7}
        for index, words in seen.items():
            assert near[index][0] <= min(words), index
            assert max(words) <= near[index][1], index
        # nothing rounds in these
        for index in (3, 4):
            assert near[index] == (min(seen[index]), max(seen[index])), index
