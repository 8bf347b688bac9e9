"""Writes checks that values are within a range, and that report states which are NaN or out of
range.
"""

from __future__ import annotations

import math

from backends.c.functions.function_writer import FunctionWriter
from backends.c.interface.status import StateCheck, StatusBit, status_macro
from backends.c_language import tree as c
from backends.c_language.functions import FunctionTable
from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope
from backends.c_language.tree import Binary, Expression, If, Name, Real, SetBits, Unary
from backends.c_lowering.state_memory import PlainState
from backends.c_lowering.values import copy_value

BUFFERS_EMPTY = 1
"""Bit of the field `ready`: buffers wait for their first sample."""

STATES_UNSET = 2
"""Bit of the field `ready`: some states are valid only after `reset`."""

INITIALISED = 4
"""Bit of the field `ready`: `init` or `reset` was called."""


def report_unready(writer: FunctionWriter) -> None:
    """Writes a check that sets the bit UNINITIALISED: neither `init` nor `reset` was called, or
    states or buffers wait for data. Nothing for a model without state.
    """
    interface = writer.interface
    if not interface.has_state:
        return
    bit = c.Name(status_macro(interface.prefix, StatusBit.UNINITIALISED))
    unready = c.Binary("!=", c.Member("s", interface.ready), c.Unsigned(INITIALISED))
    if interface.options.constant_time:
        known = writer.model.functions.truth(unready)
        writer.scope.add(c.SetBits(c.Name("status"), c.Conditional(known, bit, c.Unsigned(0))))
    else:
        writer.scope.add(c.If(unready, (c.SetBits(c.Name("status"), bit),)))


def report_not_a_number(writer: FunctionWriter, values: ArrayView) -> None:
    """Writes a check that sets STATE_OUT_OF_RANGE if an element of `values` is NaN: the next value
    of a state with `on_range: saturate`, before its limit.
    """
    # ±∞ is limited to the range, so only NaN is reported
    report_outside(writer, values, (-math.inf, math.inf), StatusBit.STATE_OUT_OF_RANGE)


def report_first_states(writer: FunctionWriter) -> None:
    """Writes checks of the initial states for `reset`: status bits for values out of range. All
    samples of buffers are checked.
    """
    for check in writer.interface.checks:
        report_outside(writer, check.memory.samples, check.limits, check.bit)


def restart_name(writer: FunctionWriter, memory: PlainState) -> str:
    """The name of the C function that sets a state to its initial value."""
    return f"{writer.interface.prefix}_restart_{memory.identifier}"


def report_next_states(writer: FunctionWriter) -> None:
    """Writes checks of the states at the end of a step: status bits for values out of range.
    `on_range: reset` also sets the state to its initial value; saturated states are skipped.
    """
    for check in writer.interface.checks:
        memory = check.memory
        if memory.state.on_range == "saturate":
            continue  # it is within the range, and the value before the limit was checked
        if memory.state.on_range == "reset":
            assert isinstance(memory, PlainState)  # true for every declared state
            _restart(writer, check, memory)
        else:
            report_outside(writer, check.place, check.limits, check.bit)


def _restart(writer: FunctionWriter, check: StateCheck, memory: PlainState) -> None:
    """Writes code that reports a state and sets all its elements to their initial values, if at
    least one element is out of range.
    """
    scope, functions = writer.scope, writer.model.functions
    restart = c.Evaluate(c.Call(restart_name(writer, memory), writer.instance()))
    values = memory.samples
    if functions.constant_time:
        _restart_in_constant_time(writer, check, memory, restart)
        return
    if not memory.shape:
        valid = within(values.element(()), *check.limits, functions)
        scope.add(c.If(c.Unary("!", valid), (_bit(writer, check.bit), restart)))
        return
    left = c.Name(scope.fresh(f"{memory.identifier}_left"))
    scope.add(c.Declare(c.CType.BOOL, left.text, c.Truth(False)))

    def look(indices: tuple[Index, ...], inner: BlockScope) -> None:
        valid = within(values.element(indices), *check.limits, functions)
        inner.add(c.If(c.Unary("!", valid), (c.Assign(left, c.Truth(True)),)))

    scope.each(memory.shape, writer.unroll, look)
    scope.add(c.If(left, (_bit(writer, check.bit), restart)))


def _restart_in_constant_time(
    writer: FunctionWriter, check: StateCheck, memory: PlainState, restart: c.Statement
) -> None:
    """Writes the check of `_restart` without branches: the statement `restart` runs in every step,
    then the next or the initial value is selected for each element.
    """
    scope, functions, values = writer.scope, writer.model.functions, memory.samples
    left = c.Name(scope.fresh(f"{memory.identifier}_left"))
    scope.add(c.Declare(c.CType.UNSIGNED, left.text, c.Unsigned(0)))
    kept = ArrayView.array(
        scope.array(f"{memory.identifier}_kept", memory.size or 1), memory.shape or (1,)
    )
    kept = kept if memory.shape else ArrayView.single(kept.element([Index()]))

    def look(indices: tuple[Index, ...], inner: BlockScope) -> None:
        low, high = check.limits
        outside = functions.helper("outside", (values.element(indices), c.Real(low), c.Real(high)))
        inner.add(c.SetBits(left, outside))

    def choose(indices: tuple[Index, ...], inner: BlockScope) -> None:
        inside = c.Binary("==", left, c.Unsigned(0))
        now = values.element(indices)
        inner.assign(now, functions.select("real", inside, kept.element(indices), now))

    scope.each(memory.shape, writer.unroll, look)
    # before `restart` overwrites them
    copy_value(values, kept, scope, writer.unroll)
    scope.add(restart)
    scope.each(memory.shape, writer.unroll, choose)
    macro = c.Name(status_macro(writer.interface.prefix, check.bit))
    scope.add(c.SetBits(c.Name("status"), c.Binary("*", left, macro)))


def _bit(writer: FunctionWriter, bit: StatusBit) -> c.Statement:
    return c.SetBits(c.Name("status"), c.Name(status_macro(writer.interface.prefix, bit)))


def within(value: Expression, low: float, high: float, functions: FunctionTable) -> Expression:
    """A C expression: low ≤ value ≤ high, False for NaN. A symmetric range uses one comparison with
    abs().
    """
    if low == -high:
        return Binary("<=", functions.library("abs", (value,)), Real(high))
    return Binary("&&", Binary(">=", value, Real(low)), Binary("<=", value, Real(high)))


def report_outside(
    writer: FunctionWriter, values: ArrayView, limits: tuple[float, float], bit: StatusBit
) -> None:
    """Writes a check that sets a status bit if an element of `values` is below or above the limits
    (low, high) or is NaN.
    """
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
