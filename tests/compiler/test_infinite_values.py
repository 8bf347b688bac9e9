"""Which values count as never 0 although they are made of infinite ones."""

from __future__ import annotations

import pytest

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph
from compiler.ir.types import Type


@pytest.mark.parametrize(
    ("function", "inside", "divides"),
    [
        ("softplus", "sin", True),  # sin(±∞) is NaN, tanh(±∞) is ±1
        ("exp", "tanh", True),
        ("softplus", None, False),  # softplus(−∞) is 0
        ("exp", "sinh", False),
    ],
)
def test_a_positive_function_is_0_only_at_infinity(
    function: str, inside: str | None, *, divides: bool
) -> None:
    """So of a friction that depends on sin q no product of slopes is tested in the second substep,
    where q is made of the quotients of the first."""
    builder = GraphBuilder(Graph(()))
    u = builder.state("u", Type())
    quotient = builder.divide(builder.constant(1.0), u)
    argument = quotient if inside is None else builder.apply(inside, quotient)
    assert builder.infinite_values.divides(builder.apply(function, argument)) is divides
