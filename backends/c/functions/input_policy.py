"""Writes the range checks of inputs in step and reset, with their policy for invalid values."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import assert_never

from backends.c.functions.state_reports import within
from backends.c.interface.interface import Field, InputField, Interface
from backends.c.interface.status import StatusBit, largest, status_macro
from backends.c_language import tree as c
from backends.c_language.functions import FunctionTable, is_nan, one_if
from backends.c_language.literals import Dtype
from backends.c_language.places import ArrayView
from backends.c_language.scope import BlockScope
from backends.c_lowering.state_memory import member_place
from backends.c_lowering.values import Indices, copy_value
from backends.ports.step_interface import Port
from compiler.ir.program import InvalidPolicy, Signal

_FUNCTIONS: dict[InvalidPolicy, str] = {"flag": "flagged", "clamp": "clamped", "hold": "held"}


def limits(signal: Signal, dtype: Dtype) -> tuple[float, float]:
    """The limits of valid values: the finite numbers within the range of the spec."""
    return _finite(signal.range, dtype)


def _finite(limits: tuple[float, float] | None, dtype: Dtype) -> tuple[float, float]:
    # the limit of the code's type: that of float64 would be infinite as a float literal
    most = largest(dtype)
    if limits is None:
        return -most, most
    low, high = limits
    # infinite inputs are never valid, even with a limit of ±∞
    return max(low, -most), min(high, most)


def stand_in(signal: Signal, dtype: Dtype) -> float:
    """The valid value nearest to 0.

    It replaces NaN, and the last valid value before there is one.
    """
    return nearest_to_zero(signal.range, dtype)


def nearest_to_zero(limits: tuple[float, float] | None, dtype: Dtype) -> float:
    """The value in the range that is nearest to 0."""
    low, high = _finite(limits, dtype)
    return min(max(0.0, low), high)


def checked_input(
    input: InputField,
    functions: FunctionTable,
    scope: BlockScope,
    unroll: int,
    *,
    remembers: bool = True,
) -> ArrayView:
    """Writes the checks of one input; returns the place of the checked values.

    With policy `hold` and `remembers`, the function stores valid values for later steps.
    """
    field, signal = input.field, input.port.signal
    check = _InputCheck(field.place("u"), signal, functions)
    if signal.on_invalid != "hold":
        return _checked(check, field.identifier, scope, unroll)
    assert input.held is not None
    held = member_place("s", input.held, field.shape)
    valid = _filled(replace(check, instead=held), field.identifier, scope, unroll)
    if remembers:
        copy_value(valid, held, scope, unroll)
    return valid


def checked_window(
    field: Field, port: Port, functions: FunctionTable, scope: BlockScope, unroll: int
) -> ArrayView:
    """Writes the checks of the samples around t0 that `reset` gets; returns the place of the
    checked samples.

    Policy `hold` replaces an invalid sample by the previous one.
    """
    check = _InputCheck(field.place("x0"), port.signal, functions)
    if port.signal.on_invalid != "hold":
        return _checked(check, field.identifier, scope, unroll)
    # the oldest sample has no previous one
    check = replace(check, instead=check.nearest_to_zero)
    if port.first == port.last:
        return _filled(check, field.identifier, scope, unroll)
    valid = ArrayView.array(scope.array(field.identifier, field.size), field.shape)
    axis, samples = len(field.shape) - 1, field.shape[-1]
    # sample by sample, since each may be replaced by the previous corrected one
    first = replace(check, given=check.given.sliced(axis, 0, 1))
    _fill(first, valid.sliced(axis, 0, 1), scope, unroll)
    later = replace(
        check,
        given=check.given.sliced(axis, 1, samples),
        instead=valid.sliced(axis, 0, samples - 1),
    )
    _fill(later, valid.sliced(axis, 1, samples), scope, unroll)
    return valid


def _checked(check: _InputCheck, name: str, scope: BlockScope, unroll: int) -> ArrayView:
    """The checked values of an input, for a policy without memory."""
    match check.signal.on_invalid:
        case "trust":
            return check.given
        case "flag":

            def report(at: Indices, inner: BlockScope) -> None:
                check.where_invalid(at, c.Evaluate(check.call(at)), inner)

            scope.each(check.given.shape, unroll, report)
            return check.given
        case "clamp":
            return _filled(replace(check, instead=check.nearest_to_zero), name, scope, unroll)
        case "hold":
            raise AssertionError("the caller says what it falls back to")
        case _:
            assert_never(check.signal.on_invalid)


@dataclass(frozen=True, slots=True)
class _InputCheck:
    """Calls the function of a policy; in constant time always, otherwise for invalid values
    only.
    """

    given: ArrayView
    """The values before the check."""
    signal: Signal
    functions: FunctionTable
    instead: ArrayView | None = None
    """Replacement for NaN, or for every invalid value."""

    @property
    def nearest_to_zero(self) -> ArrayView:
        """The valid value nearest to 0, for every element."""
        value = ArrayView.single(c.Real(stand_in(self.signal, self.functions.dtype)))
        return value.reshaped_single(self.given.shape)

    def call(self, at: Indices) -> c.Expression:
        """A call that reports an element and returns the corrected value."""
        low, high = self._limits
        instead = () if self.instead is None else (self.instead.element(at),)
        function = f"{self.functions.prefix}_{_FUNCTIONS[self.signal.on_invalid]}"
        status = c.Unary("&", c.Name("status"))
        return c.Call(
            function, (self.given.element(at), c.Real(low), c.Real(high), *instead, status)
        )

    def where_invalid(self, at: Indices, statement: c.Statement, scope: BlockScope) -> None:
        """Writes the statement with the call, executed only if the value is invalid."""
        if self.functions.constant_time:
            # always called: with a branch, the time would depend on the value
            scope.add(statement)
            return
        # an inline comparison, and a call for invalid values only, which are rare
        valid = within(self.given.element(at), *self._limits, self.functions)
        scope.add(c.If(c.Unary("!", valid), (statement,)))

    @property
    def _limits(self) -> tuple[float, float]:
        return limits(self.signal, self.functions.dtype)


def _filled(check: _InputCheck, name: str, scope: BlockScope, unroll: int) -> ArrayView:
    """A local variable with the corrected values of an input."""
    shape = check.given.shape
    if not shape:
        if check.functions.constant_time:
            return ArrayView.single(scope.constant(name, check.call(())))
        value = scope.variable(name, check.given.element(()))
        check.where_invalid((), c.Assign(value, check.call(())), scope)
        return ArrayView.single(value)
    place = ArrayView.array(scope.array(name, math.prod(shape)), shape)
    _fill(check, place, scope, unroll)
    return place


def _fill(check: _InputCheck, place: ArrayView, scope: BlockScope, unroll: int) -> None:
    """Writes the corrected values to a place, element by element."""

    def correct(at: Indices, inner: BlockScope) -> None:
        if not check.functions.constant_time:
            inner.assign(place.element(at), check.given.element(at))
        check.where_invalid(at, c.Assign(place.element(at), check.call(at)), inner)

    scope.each(place.shape, unroll, correct)


def policy_functions(interface: Interface, table: FunctionTable) -> tuple[c.Function, ...]:
    """Definitions of the check functions that step, reset and linearize use."""
    ports = (*(i.port for i in interface.inputs), *(port for _, port in interface.windows))
    used = {port.signal.on_invalid for port in ports}
    return tuple(
        _check(
            table.prefix,
            policy,
            constant_time_check(policy, table) if table.constant_time else body(table.prefix),
        )
        for policy, (_, body) in _CHECKS.items()
        # unused static functions cause compiler warnings and MISRA findings
        if policy in used
    )


_X = c.Name("x")
_LOW = c.Name("low")
_HIGH = c.Name("high")
_RESULT = c.Name("result")
_INSTEAD = c.Name("instead")
_BELOW, _ABOVE = c.Binary("<", _X, _LOW), c.Binary(">", _X, _HIGH)
_OUTSIDE = c.Binary("||", _BELOW, _ABOVE)
"""False for NaN, like every comparison with it."""


def _bit(prefix: str, bit: StatusBit) -> c.Statement:
    return c.SetBits(c.Unary("*", c.Name("status")), c.Name(status_macro(prefix, bit)))


def _flagged(prefix: str) -> tuple[c.Statement, ...]:
    outside = _bit(prefix, StatusBit.OUT_OF_RANGE)
    return (c.If(_OUTSIDE, (outside,), (_bit(prefix, StatusBit.NOT_A_NUMBER),)),)


def _clamped(prefix: str) -> tuple[c.Statement, ...]:
    to_low, to_high = c.Assign(_RESULT, _LOW), c.Assign(_RESULT, _HIGH)
    # neither above nor below: NaN
    unordered = (_bit(prefix, StatusBit.NOT_A_NUMBER),)
    nearest = c.If(_ABOVE, (to_high,), (c.If(_BELOW, (to_low,), unordered),))
    # initialised with the replacement of NaN; numbers overwrite it below
    given = c.Declare(c.CType.REAL, _RESULT.text, _INSTEAD)
    return (given, _bit(prefix, StatusBit.CLAMPED), nearest, c.Return(_RESULT))


def _held(prefix: str) -> tuple[c.Statement, ...]:
    unordered = c.If(c.Unary("!", _OUTSIDE), (_bit(prefix, StatusBit.NOT_A_NUMBER),))
    return (_bit(prefix, StatusBit.HELD), unordered, c.Return(_INSTEAD))


def _check(prefix: str, policy: InvalidPolicy, body: tuple[c.Statement, ...]) -> c.Function:
    real = f"{prefix}_real"
    names = ["x", "low", "high", *([] if policy == "flag" else [_INSTEAD.text])]
    return c.Function(
        name=f"{prefix}_{_FUNCTIONS[policy]}",
        result="void" if policy == "flag" else real,
        arguments=(
            *(c.Argument(real, name) for name in names),
            c.Argument(f"{prefix}_status_t *", "status"),
        ),
        body=body,
        doc=_CHECKS[policy][0],
        static=True,
        inline=True,
    )


_CHECKS: dict[InvalidPolicy, tuple[str, Callable[[str], tuple[c.Statement, ...]]]] = {
    "flag": ("Reports a value outside low .. high.", _flagged),
    "clamp": ("A value outside low .. high moved into it; another one instead of NaN.", _clamped),
    "hold": ("Another one instead of a value outside low .. high.", _held),
}


_OUTSIDE_COUNT = c.Name("outside")
_UNORDERED = c.Name("unordered")


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
        _count(_OUTSIDE_COUNT, table.helper("outside", (_X, _LOW, _HIGH))),
        _count(_UNORDERED, one_if(table.truth(is_nan(_X)))),
    )
    unordered = bits(StatusBit.NOT_A_NUMBER, _UNORDERED)
    match policy:
        case "flag":
            # NaN also counts as outside, but has a separate status bit
            ordered = c.Binary("-", _OUTSIDE_COUNT, _UNORDERED)
            return (*found, bits(StatusBit.OUT_OF_RANGE, ordered), unordered)
        case "clamp":
            # NaN fails both comparisons below and must be replaced first
            number = select(c.Binary("!=", _UNORDERED, c.Unsigned(0)), _INSTEAD, _X)
            raised = select(table.truth(c.Binary("<", _X, _LOW)), _LOW, number)
            result = c.Return(select(table.truth(c.Binary(">", _X, _HIGH)), _HIGH, raised))
            return (*found, bits(StatusBit.CLAMPED, _OUTSIDE_COUNT), unordered, result)
        case "hold":
            result = c.Return(select(c.Binary("!=", _OUTSIDE_COUNT, c.Unsigned(0)), _INSTEAD, _X))
            return (*found, bits(StatusBit.HELD, _OUTSIDE_COUNT), unordered, result)
        case "trust":
            return ()


def _count(name: c.Name, value: c.Expression) -> c.Statement:
    return c.Declare(c.CType.UNSIGNED, name.text, value, constant=True)
