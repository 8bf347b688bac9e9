"""Checks inputs against their range in the same instructions for every value."""

from __future__ import annotations

from backends.c.interface.status import StatusBit, status_macro
from backends.c_language.functions import FunctionTable
from backends.c_language.helper_functions import is_nan, one_if
from backends.c_language.tree import (
    Binary,
    CType,
    Declare,
    Expression,
    Name,
    Return,
    SetBits,
    Statement,
    Unary,
    Unsigned,
)
from compiler.ir.program import InvalidPolicy

_X, _LOW, _HIGH, _INSTEAD = Name("x"), Name("low"), Name("high"), Name("instead")
_OUTSIDE, _UNORDERED = Name("outside"), Name("unordered")


def constant_time_check(policy: InvalidPolicy, table: FunctionTable) -> tuple[Statement, ...]:
    """The body of the function that checks x; the arguments are those of the other form."""

    def bits(bit: StatusBit, count: Expression) -> Statement:
        value = Binary("*", count, Name(status_macro(table.prefix, bit)))
        return SetBits(Unary("*", Name("status")), value)

    def select(condition: Expression, then: Expression, otherwise: Expression) -> Expression:
        return table.select("real", condition, then, otherwise)

    found = (
        _count(_OUTSIDE, table.helper("outside", (_X, _LOW, _HIGH))),
        _count(_UNORDERED, one_if(table.truth(is_nan(_X)))),
    )
    unordered = bits(StatusBit.NOT_A_NUMBER, _UNORDERED)
    match policy:
        case "flag":
            ordered = Binary("-", _OUTSIDE, _UNORDERED)
            return (*found, bits(StatusBit.OUT_OF_RANGE, ordered), unordered)
        case "clamp":
            number = select(Binary("!=", _UNORDERED, Unsigned(0)), _INSTEAD, _X)
            raised = select(table.truth(Binary("<", _X, _LOW)), _LOW, number)
            result = Return(select(table.truth(Binary(">", _X, _HIGH)), _HIGH, raised))
            return (*found, bits(StatusBit.CLAMPED, _OUTSIDE), unordered, result)
        case "hold":
            result = Return(select(Binary("!=", _OUTSIDE, Unsigned(0)), _INSTEAD, _X))
            return (*found, bits(StatusBit.HELD, _OUTSIDE), unordered, result)
        case "trust":
            return ()


def _count(name: Name, value: Expression) -> Statement:
    return Declare(CType.UNSIGNED, name.text, value, constant=True)
