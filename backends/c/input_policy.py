"""What a step does about inputs outside their range, in C."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from typing import assert_never

import numpy as np

from backends.c.c_language import (
    Argument,
    Assign,
    Binary,
    Call,
    CType,
    Declare,
    Evaluate,
    Expression,
    Function,
    If,
    Name,
    Real,
    Return,
    SetBits,
    Statement,
    Unary,
)
from backends.c.c_literals import Dtype
from backends.c.constant_time_checks import constant_time_check
from backends.c.functions import FunctionTable
from backends.c.interface import InputField
from backends.c.places import Index, Place
from backends.c.scope import Scope
from backends.c.state_memory import member_place
from backends.c.status import Status, status_macro
from backends.c.values import copy_value
from compiler.program import InvalidPolicy, Signal

_FUNCTIONS: dict[InvalidPolicy, str] = {"flag": "flagged", "clamp": "clamped", "hold": "held"}


def limits(signal: Signal, dtype: Dtype) -> tuple[float, float]:
    """What is valid: the finite numbers within the range of the spec."""
    largest = float(np.finfo(np.float32).max) if dtype == "float32" else sys.float_info.max
    if signal.range is None:
        return -largest, largest
    low, high = signal.range
    return max(low, -largest), min(high, largest)


def stand_in(signal: Signal, dtype: Dtype) -> float:
    """What replaces NaN, or a last valid value before there is one: the valid one nearest to 0."""
    low, high = limits(signal, dtype)
    return min(max(0.0, low), high)


def checked_input(input: InputField, prefix: str, dtype: Dtype, scope: Scope, unroll: int) -> Place:
    """Writes the checks of one input; returns where the step finds its values."""
    given, signal = input.field.place("u"), input.port.signal
    low, high = (Real(limit) for limit in limits(signal, dtype))

    def check(indices: tuple[Index, ...], *instead: Expression) -> Expression:
        function = f"{prefix}_{_FUNCTIONS[signal.on_invalid]}"
        status = Unary("&", Name("status"))
        return Call(function, (given.element(indices), low, high, *instead, status))

    match signal.on_invalid:
        case "trust":
            return given
        case "flag":
            scope.each(given.shape, unroll, lambda at, inner: inner.add(Evaluate(check(at))))
            return given
        case "clamp":
            instead = Real(stand_in(signal, dtype))
            return _filled(input, scope, unroll, lambda at: check(at, instead))
        case "hold":
            assert input.held is not None
            held = member_place("s", input.held, input.field.shape)
            valid = _filled(input, scope, unroll, lambda at: check(at, held.element(at)))
            copy_value(valid, held, scope, unroll)
            return valid
        case _:
            assert_never(signal.on_invalid)


def _filled(
    input: InputField,
    scope: Scope,
    unroll: int,
    value: Callable[[tuple[Index, ...]], Expression],
) -> Place:
    """A local with the corrected values of an input."""
    field = input.field
    if not field.shape:
        return Place.single(scope.constant(field.identifier, value(())))
    place = Place.array(scope.array(field.identifier, field.size), field.shape)
    scope.each(field.shape, unroll, lambda at, inner: inner.assign(place.element(at), value(at)))
    return place


def policy_functions(inputs: Iterable[InputField], table: FunctionTable) -> tuple[Function, ...]:
    """Definitions of the checks that these inputs need."""
    used = {input.port.signal.on_invalid for input in inputs}
    return tuple(
        _check(
            table.prefix,
            policy,
            constant_time_check(policy, table) if table.constant_time else body(table.prefix),
        )
        for policy, (_, body) in _CHECKS.items()
        if policy in used
    )


_X, _LOW, _HIGH, _RESULT = Name("x"), Name("low"), Name("high"), Name("result")
_INSTEAD = Name("instead")
_BELOW, _ABOVE = Binary("<", _X, _LOW), Binary(">", _X, _HIGH)
# false for NaN, as every comparison with it is
_VALID = Binary("&&", Binary(">=", _X, _LOW), Binary("<=", _X, _HIGH))
_GIVEN = Declare(CType.REAL, _RESULT.text, _X)


def _bit(prefix: str, bit: Status) -> Statement:
    return SetBits(Unary("*", Name("status")), Name(status_macro(prefix, bit)))


def _flagged(prefix: str) -> tuple[Statement, ...]:
    outside = _bit(prefix, Status.OUT_OF_RANGE)
    unordered = _bit(prefix, Status.NOT_A_NUMBER)
    choice = If(Binary("||", _BELOW, _ABOVE), (outside,), (unordered,))
    return (If(Unary("!", _VALID), (choice,)),)


def _clamped(prefix: str) -> tuple[Statement, ...]:
    bit, unordered = _bit(prefix, Status.CLAMPED), _bit(prefix, Status.NOT_A_NUMBER)
    to_low, to_high = Assign(_RESULT, _LOW), Assign(_RESULT, _HIGH)
    replaced = (Assign(_RESULT, _INSTEAD), unordered)
    nearest = If(_ABOVE, (to_high,), (If(_BELOW, (to_low,), replaced),))
    return (_GIVEN, If(Unary("!", _VALID), (bit, nearest)), Return(_RESULT))


def _held(prefix: str) -> tuple[Statement, ...]:
    bit, unordered = _bit(prefix, Status.HELD), _bit(prefix, Status.NOT_A_NUMBER)
    unordered_only = If(Unary("!", Binary("||", _BELOW, _ABOVE)), (unordered,))
    replaced = If(Unary("!", _VALID), (bit, Assign(_RESULT, _INSTEAD), unordered_only))
    return (_GIVEN, replaced, Return(_RESULT))


def _check(prefix: str, policy: InvalidPolicy, body: tuple[Statement, ...]) -> Function:
    real = f"{prefix}_real"
    names = ["x", "low", "high", *([] if policy == "flag" else [_INSTEAD.text])]
    return Function(
        f"{prefix}_{_FUNCTIONS[policy]}",
        "void" if policy == "flag" else real,
        (*(Argument(real, name) for name in names), Argument(f"{prefix}_status_t *", "status")),
        body,
        _CHECKS[policy][0],
        static=True,
        inline=True,
    )


_CHECKS: dict[InvalidPolicy, tuple[str, Callable[[str], tuple[Statement, ...]]]] = {
    "flag": ("Reports a value outside low .. high and leaves it as it is.", _flagged),
    "clamp": ("The value moved into low .. high; another one instead of NaN.", _clamped),
    "hold": ("The value, or another one instead where it is outside low .. high.", _held),
}
