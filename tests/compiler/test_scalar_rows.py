"""Rows of the table of scalar functions, run with plain numbers instead of nodes of a graph."""

from __future__ import annotations

import math

import numpy as np
import pytest

from compiler.ir.scalars import SCALAR_FUNCTIONS, ByFormula, ScalarFunction

ROWS = list(SCALAR_FUNCTIONS.values())


class Numbers:
    """`Arithmetic` of floats."""

    def constant(self, value: float, /) -> float:
        return value

    def add(self, left: float, right: float, /) -> float:
        return left + right

    def subtract(self, left: float, right: float, /) -> float:
        return left - right

    def multiply(self, left: float, right: float, /) -> float:
        return left * right

    def divide(self, left: float, right: float, /) -> float:
        return left / right

    def negate(self, value: float, /) -> float:
        return -value

    def where_negative(self, value: float, then: float, otherwise: float, /) -> float:
        return then if value < 0 else otherwise

    @property
    def infinite_values(self) -> Numbers:
        return self

    def can_be_infinite(self, value: float, /) -> bool:
        return True

    def divides(self, value: float, /) -> bool:
        return False

    def is_never_zero(self, value: float, /) -> bool:
        return value != 0

    def zero_with(self, factor: float, product: float, /) -> float:
        return 0.0 if factor == 0 else product

    def apply(self, function: str, /, *args: float) -> float:
        return float(SCALAR_FUNCTIONS[function].numpy(*args))


def _samples(row: ScalarFunction) -> list[tuple[float, ...]]:
    """Points of its domain, never on a kink at 0."""
    drawn = np.random.default_rng(7).uniform(size=(50, row.arity))
    low, high = np.array(row.domain).T
    return [tuple(map(float, low + (high - low) * draw)) for draw in drawn]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_a_slope_is_the_limit_of_differences(row: ScalarFunction) -> None:
    for point in _samples(row):
        value = float(row.numpy(*point))
        for place, derivative in enumerate(row.derivatives):
            step = 3e-6 * max(1.0, abs(point[place]))
            moved = [list(point), list(point)]
            moved[0][place] += step
            moved[1][place] -= step
            above, below = (float(row.numpy(*p)) for p in moved)
            found = derivative(Numbers(), point, value)
            # h² of the differences and rounding of the values over h
            size = max(abs(found), abs(value), 1.0)
            assert math.isclose(found, (above - below) / (2 * step), abs_tol=1e-7 * size)


@pytest.mark.parametrize(
    "row", [row for row in ROWS if isinstance(row.definition, ByFormula)], ids=lambda row: row.name
)
def test_a_formula_is_the_function(row: ScalarFunction) -> None:
    assert isinstance(row.definition, ByFormula)
    for point in _samples(row):
        found = row.definition.formula(Numbers(), point)
        assert math.isclose(found, float(row.numpy(*point)), rel_tol=1e-14)


@pytest.mark.parametrize("name", ["sigmoid", "softplus"])
def test_a_formula_has_the_digits_of_a_tail(name: str) -> None:
    """Also where 1 + e^x is 1, and e^−x infinite."""
    row = SCALAR_FUNCTIONS[name]
    assert isinstance(row.definition, ByFormula)
    for x in (-1e-9, -20.0, -34.0, -36.5, -50.0, -400.0, -705.0, -720.0, -1000.0, -math.inf):
        found = row.definition.formula(Numbers(), (x,))
        assert math.isclose(found, float(row.numpy(x)), rel_tol=1e-14)
