"""What a step does about inputs outside their range, in C."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from backends.c.functions.constant_time_checks import constant_time_check
from backends.c.functions.valid_range import within
from backends.c.interface.interface import InputField
from backends.c.interface.status import Status, status_macro
from backends.c_language.functions import FunctionTable
from backends.c_language.literals import Dtype
from backends.c_language.places import Place
from backends.c_language.scope import Scope
from backends.c_language.tree import (
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
from backends.c_lowering.state_memory import member_place
from backends.c_lowering.values import Indices, copy_value
from compiler.ir.program import InvalidPolicy, Signal

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


def checked_input(
    input: InputField,
    functions: FunctionTable,
    scope: Scope,
    unroll: int,
    *,
    remembers: bool = True,
) -> Place:
    """Writes the checks of one input; returns where the step finds its values.

    What `hold` falls back to is replaced by valid values where the function `remembers` them.
    """
    given, policy = input.field.place("u"), input.port.signal.on_invalid
    match policy:
        case "trust":
            return given
        case "flag":
            check = _Check(input, functions)

            def report(at: Indices, inner: Scope) -> None:
                check.where_invalid(at, Evaluate(check.call(at)), inner)

            scope.each(given.shape, unroll, report)
            return given
        case "clamp":
            instead = Place.single(Real(stand_in(input.port.signal, functions.dtype)))
            return _filled(_Check(input, functions, instead), scope, unroll)
        case "hold":
            assert input.held is not None
            held = member_place("s", input.held, input.field.shape)
            valid = _filled(_Check(input, functions, held), scope, unroll)
            if remembers:
                copy_value(valid, held, scope, unroll)
            return valid
        case _:
            assert_never(policy)


@dataclass(frozen=True, slots=True)
class _Check:
    """Calls the function of a policy; where time may depend on numbers, for invalid ones only."""

    input: InputField
    functions: FunctionTable
    instead: Place | None = None
    """What replaces NaN, or every invalid value."""

    def given(self, at: Indices) -> Expression:
        """An element as it came."""
        return self.input.field.place("u").element(at)

    def call(self, at: Indices) -> Expression:
        """Reports an element, its value is the corrected one."""
        low, high = self._limits
        instead = () if self.instead is None else (self.instead.element(at),)
        function = f"{self.functions.prefix}_{_FUNCTIONS[self.input.port.signal.on_invalid]}"
        status = Unary("&", Name("status"))
        return Call(function, (self.given(at), Real(low), Real(high), *instead, status))

    def where_invalid(self, at: Indices, statement: Statement, scope: Scope) -> None:
        """Writes the statement with the call, under the test whether there is need of it."""
        if self.functions.constant_time:
            scope.add(statement)
            return
        valid = within(self.given(at), *self._limits, self.functions)
        scope.add(If(Unary("!", valid), (statement,)))

    @property
    def _limits(self) -> tuple[float, float]:
        return limits(self.input.port.signal, self.functions.dtype)


def _filled(check: _Check, scope: Scope, unroll: int) -> Place:
    """A local with the corrected values of an input."""
    field, constant_time = check.input.field, check.functions.constant_time
    if not field.shape:
        if constant_time:
            return Place.single(scope.constant(field.identifier, check.call(())))
        value = scope.variable(field.identifier, check.given(()))
        check.where_invalid((), Assign(value, check.call(())), scope)
        return Place.single(value)
    place = Place.array(scope.array(field.identifier, field.size), field.shape)

    def correct(at: Indices, inner: Scope) -> None:
        if not constant_time:
            inner.assign(place.element(at), check.given(at))
        check.where_invalid(at, Assign(place.element(at), check.call(at)), inner)

    scope.each(field.shape, unroll, correct)
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
_OUTSIDE = Binary("||", _BELOW, _ABOVE)
"""False for NaN, as every comparison with it is."""


def _bit(prefix: str, bit: Status) -> Statement:
    return SetBits(Unary("*", Name("status")), Name(status_macro(prefix, bit)))


def _flagged(prefix: str) -> tuple[Statement, ...]:
    outside = _bit(prefix, Status.OUT_OF_RANGE)
    return (If(_OUTSIDE, (outside,), (_bit(prefix, Status.NOT_A_NUMBER),)),)


def _clamped(prefix: str) -> tuple[Statement, ...]:
    to_low, to_high = Assign(_RESULT, _LOW), Assign(_RESULT, _HIGH)
    unordered = (_bit(prefix, Status.NOT_A_NUMBER),)
    nearest = If(_ABOVE, (to_high,), (If(_BELOW, (to_low,), unordered),))
    given = Declare(CType.REAL, _RESULT.text, _INSTEAD)
    return (given, _bit(prefix, Status.CLAMPED), nearest, Return(_RESULT))


def _held(prefix: str) -> tuple[Statement, ...]:
    unordered = If(Unary("!", _OUTSIDE), (_bit(prefix, Status.NOT_A_NUMBER),))
    return (_bit(prefix, Status.HELD), unordered, Return(_INSTEAD))


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
    "flag": ("Reports a value outside low .. high.", _flagged),
    "clamp": ("A value outside low .. high moved into it; another one instead of NaN.", _clamped),
    "hold": ("Another one instead of a value outside low .. high.", _held),
}
