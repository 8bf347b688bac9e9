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


@pytest.mark.parametrize(
    ("low", "high", "divides"),
    [
        (1.0, 2.0, True),
        (0.0, 2.0, False),
        # where limits cross the upper one is the value, which may be 0
        (1.0, 0.0, False),
        (1.0, None, False),
    ],
)
def test_a_clamp_is_never_0_where_neither_limit_can_be(
    low: float, high: float | None, *, divides: bool
) -> None:
    builder = GraphBuilder(Graph(()))
    upper = builder.state("h", Type()) if high is None else builder.constant(high)
    clamped = builder.clamp(builder.state("u", Type()), builder.constant(low), upper)
    assert builder.infinite_values.divides(clamped) is divides
