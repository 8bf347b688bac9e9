"""The test whether a number lies in the range that the spec declares for it."""

from __future__ import annotations

from backends.c_language.functions import FunctionTable
from backends.c_language.tree import Binary, Expression, Real


def within(value: Expression, low: float, high: float, functions: FunctionTable) -> Expression:
    """low ≤ value ≤ high, false for NaN; of a range around 0 in one comparison."""
    if low == -high:
        return Binary("<=", functions.library("abs", (value,)), Real(high))
    return Binary("&&", Binary(">=", value, Real(low)), Binary("<=", value, Real(high)))
