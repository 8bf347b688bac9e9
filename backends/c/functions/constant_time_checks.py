"""Checks inputs against their range in the same instructions for every value."""

from __future__ import annotations

from backends.c.interface.status import StatusBit, status_macro
from backends.c_language import tree as c
from backends.c_language.functions import FunctionTable
from backends.c_language.helper_functions import is_nan, one_if
from compiler.ir.program import InvalidPolicy

_X, _LOW, _HIGH, _INSTEAD = c.Name("x"), c.Name("low"), c.Name("high"), c.Name("instead")
_OUTSIDE, _UNORDERED = c.Name("outside"), c.Name("unordered")


def constant_time_check(policy: InvalidPolicy, table: FunctionTable) -> tuple[c.Statement, ...]:
    """The body of the function that checks x; the arguments are those of the other form."""

    def bits(bit: StatusBit, count: c.Expression) -> c.Statement:
        value = c.Binary("*", count, c.Name(status_macro(table.prefix, bit)))
        return c.SetBits(c.Unary("*", c.Name("status")), value)

    def select(
        condition: c.Expression, then: c.Expression, otherwise: c.Expression
    ) -> c.Expression:
        return table.select("real", condition, then, otherwise)

    found = (
        _count(_OUTSIDE, table.helper("outside", (_X, _LOW, _HIGH))),
        _count(_UNORDERED, one_if(table.truth(is_nan(_X)))),
    )
    unordered = bits(StatusBit.NOT_A_NUMBER, _UNORDERED)
    match policy:
        case "flag":
            # NaN is outside as well: it has a bit of its own and not that of numbers
            ordered = c.Binary("-", _OUTSIDE, _UNORDERED)
            return (*found, bits(StatusBit.OUT_OF_RANGE, ordered), unordered)
        case "clamp":
            # NaN is less than neither limit and would come through both choices below
            number = select(c.Binary("!=", _UNORDERED, c.Unsigned(0)), _INSTEAD, _X)
            raised = select(table.truth(c.Binary("<", _X, _LOW)), _LOW, number)
            result = c.Return(select(table.truth(c.Binary(">", _X, _HIGH)), _HIGH, raised))
            return (*found, bits(StatusBit.CLAMPED, _OUTSIDE), unordered, result)
        case "hold":
            result = c.Return(select(c.Binary("!=", _OUTSIDE, c.Unsigned(0)), _INSTEAD, _X))
            return (*found, bits(StatusBit.HELD, _OUTSIDE), unordered, result)
        case "trust":
            return ()


def _count(name: c.Name, value: c.Expression) -> c.Statement:
    return c.Declare(c.CType.UNSIGNED, name.text, value, constant=True)
