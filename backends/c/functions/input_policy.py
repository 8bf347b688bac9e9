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
    """(low, high) of valid values of a signal: its range in the spec, limited to the finite values
    of the code's type.
    """
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
    """The valid value of a signal that is nearest to 0. It replaces NaN under policy clamp, and is
    the held value before the first valid one.
    """
    return nearest_to_zero(signal.range, dtype)


def nearest_to_zero(limits: tuple[float, float] | None, dtype: Dtype) -> float:
    """The value within `limits` (None: all finite values) that is nearest to 0."""
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
    """Writes the checks of one input of the step; returns the place of the checked values. Loops of
    up to `unroll` elements are written out. With policy `hold` and `remembers`, the code also
    stores the checked values in the state struct for later steps.
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
    checked samples. Policy `hold` replaces an invalid sample by the previous one, and the oldest by
    the valid value nearest to 0.
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
    """Writes the checks of an input with policy trust, flag or clamp; returns the place of the
    checked values. `name` is the base of the names of local variables.
    """
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
    """The check of one input: writes calls of the C function of its policy. In constant time the
    call is unconditional, otherwise it is made for invalid values only.
    """

    given: ArrayView
    """The values before the check."""
    signal: Signal
    functions: FunctionTable
    instead: ArrayView | None = None
    """Replacement for NaN, or for every invalid value."""

    @property
    def nearest_to_zero(self) -> ArrayView:
        """The valid value nearest to 0, as a view with the shape of the input in which all elements
        are that one value.
        """
        value = ArrayView.single(c.Real(stand_in(self.signal, self.functions.dtype)))
        return value.reshaped_single(self.given.shape)

    def call(self, at: Indices) -> c.Expression:
        """A call of the policy's function for the element with the indices `at`: it sets status
        bits and, except for policy flag, returns the corrected value.
        """
        low, high = self._limits
        instead = () if self.instead is None else (self.instead.element(at),)
        function = f"{self.functions.prefix}_{_FUNCTIONS[self.signal.on_invalid]}"
        status = c.Unary("&", c.Name("status"))
        return c.Call(
            function, (self.given.element(at), c.Real(low), c.Real(high), *instead, status)
        )

    def where_invalid(self, at: Indices, statement: c.Statement, scope: BlockScope) -> None:
        """Adds `statement`, which calls the policy's function for the element `at`, to the scope.
        The statement is executed only if the element is invalid, in constant time always.
        """
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
    """Writes the values of the input of `check`, with invalid elements corrected, to a new local
    variable called `name`; returns its place.
    """
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
    """Writes the values of the input of `check`, with invalid elements corrected, to the place
    `place`.
    """

    def correct(at: Indices, inner: BlockScope) -> None:
        if not check.functions.constant_time:
            inner.assign(place.element(at), check.given.element(at))
        check.where_invalid(at, c.Assign(place.element(at), check.call(at)), inner)

    scope.each(place.shape, unroll, correct)


def policy_functions(interface: Interface, table: FunctionTable) -> tuple[c.Function, ...]:
    """Definitions of the C functions that check values, one for each policy that an input or a
    sample of `reset` has.
    """
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
    """The body of a policy's C function without branches; its arguments are the same as those of
    the version with branches. Empty for policy trust.
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
