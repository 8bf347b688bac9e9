"""Tests if values are within a range, and reports those that are not."""

from __future__ import annotations

from backends.c.functions.function_writer import FunctionWriter
from backends.c.interface.status import StatusBit, status_macro
from backends.c_language.functions import FunctionTable
from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope
from backends.c_language.tree import Binary, Expression, If, Name, Real, SetBits, Unary


def within(value: Expression, low: float, high: float, functions: FunctionTable) -> Expression:
    """low ≤ value ≤ high, False for NaN; a symmetric range needs one comparison."""
    if low == -high:
        return Binary("<=", functions.library("abs", (value,)), Real(high))
    return Binary("&&", Binary(">=", value, Real(low)), Binary("<=", value, Real(high)))


def report_outside(
    writer: FunctionWriter, values: ArrayView, limits: tuple[float, float], bit: StatusBit
) -> None:
    """Sets a status bit if an element is outside the limits; NaN always is."""
    low, high = limits
    functions = writer.model.functions
    macro = Name(status_macro(writer.interface.prefix, bit))

    def check(indices: tuple[Index, ...], scope: BlockScope) -> None:
        value = values.element(indices)
        if functions.constant_time:
            outside = functions.helper("outside", (value, Real(low), Real(high)))
            scope.add(SetBits(Name("status"), Binary("*", outside, macro)))
            return
        valid = within(value, low, high, functions)
        # not `value < low || value > high`, which is false for NaN
        scope.add(If(Unary("!", valid), (SetBits(Name("status"), macro),)))

    writer.scope.each(values.shape, writer.unroll, check)
