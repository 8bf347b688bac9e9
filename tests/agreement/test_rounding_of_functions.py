"""Bounds of rounding hold for functions of arguments that are known to few digits or none."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.interpreter.bounded import Bounded
from compiler.interpreter.rounding import BoundedGraph
from compiler.ir.builder import GraphBuilder
from compiler.ir.types import Type

WIDTHS = (1e-9, 1e-3, 0.3, 0.6, 1.5, 3.0, 40.0)


@pytest.mark.parametrize("function", ["sin", "cos", "tan", "tanh", "exp", "cosh", "softplus"])
def test_no_argument_within_its_bound_has_a_value_beyond_that_of_the_function(
    function: str,
) -> None:
    """A cosine of 1e10 that is known to a few radians can be anything."""
    builder = GraphBuilder()
    node = builder.apply(function, builder.state("x", Type()))
    graph = BoundedGraph(builder.graph(), [node], {}, np.dtype(np.float64))
    random = np.random.default_rng(4)
    for width in WIDTHS:
        centre = random.uniform(-5.0, 5.0, 400)
        wide = np.full_like(centre, width)
        given = {"x": Bounded(centre, wide, np.abs(centre) + wide, 1)}
        found = graph.run({}, np.arange(len(centre)), given)[node]
        spread = found.spread(graph.unit)
        meaning = getattr(np, function, lambda x: np.logaddexp(x, 0.0))
        with np.errstate(all="ignore"):
            for _ in range(50):
                moved = meaning(centre + width * random.uniform(-1.0, 1.0, len(centre)))
                assert np.all(np.abs(moved - found.value) <= spread), width
