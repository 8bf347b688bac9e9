"""Checks inputs against their range with the same instructions for every value."""

from __future__ import annotations

from backends.c.interface.status import StatusBit, status_macro
from backends.c_language import tree as c
from backends.c_language.functions import FunctionTable
from backends.c_language.helper_functions import is_nan, one_if
from compiler.ir.program import InvalidPolicy

_X, _LOW, _HIGH, _INSTEAD = c.Name("x"), c.Name("low"), c.Name("high"), c.Name("instead")
_OUTSIDE, _UNORDERED = c.Name("outside"), c.Name("unordered")


def constant_time_check(policy: InvalidPolicy, table: FunctionTable) -> tuple[c.Statement, ...]:
    """The body of the function that checks x, with the same arguments as the version with
    branches.
    """

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
            # NaN also counts as outside, but has a separate status bit
            ordered = c.Binary("-", _OUTSIDE, _UNORDERED)
            return (*found, bits(StatusBit.OUT_OF_RANGE, ordered), unordered)
        case "clamp":
            # NaN fails both comparisons below and must be replaced first
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
