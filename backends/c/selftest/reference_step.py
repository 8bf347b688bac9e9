"""Computes in NumPy the parts of generated C that are in no graph: policies, checks, first
states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from backends.c.functions.input_policy import limits, stand_in
from backends.c.interface.interface import Interface
from backends.c.interface.status import StateCheck, StatusBit
from backends.c_language.literals import Dtype
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Output, Program, Signal
from compiler.passes.analyses.saturation import unsaturated

Array = NDArray[Any]


def emptied(interface: Interface, states: Mapping[str, Array]) -> dict[str, Array]:
    """The states after `init`, by name: a copy of `states` in which those that need recorded
    samples are 0.
    """
    return {
        name: np.zeros_like(value) if name in interface.from_record else value
        for name, value in states.items()
    }


def filled_by_first(
    interpreter: Interpreter,
    interface: Interface,
    states: Mapping[str, Array],
    log: tuple[dict[str, Array], NDArray[np.int64]],
    rows: Sequence[int],
) -> dict[str, Array]:
    """The states (B, *shape) with buffers filled by the newest sample of the first step, for the
    batch members `rows`, which begin with `init`. `log` is the log and the row of each member. The
    newest sample of a buffer may depend on other buffers, so filling is repeated once per buffer.
    """
    filled = {name: value.copy() for name, value in states.items()}
    # a chain of buffers that read each other is at most as long as their count
    for _ in interface.filled_by_first:
        following = interpreter.step(*log, filled, losses=False).next_states
        for name in interface.filled_by_first:
            newest = following[name][rows, ..., -1:]
            filled[name][rows] = np.broadcast_to(newest, filled[name][rows].shape)
    return filled


def log_of_steps(
    interface: Interface, inputs: Mapping[str, Array], count: int
) -> tuple[dict[str, Array], NDArray[np.int64]]:
    """A log (rows, *shape) by name that contains the inputs of `count` independent steps, and the
    row (count,) at which each step reads its own. `inputs` are (count, *shape), with the samples of
    a preview along their last axis.
    """
    ports = {input.field.name: input.port for input in interface.inputs}
    row = max([0, *(-port.first for port in ports.values())])
    # each step has rows of its own, as policies may have changed what its neighbours saw
    rows = row + 1 + max([0, *(port.last for port in ports.values())])
    log: dict[str, Array] = {}
    for name, port in ports.items():
        values = inputs[name]
        samples = values[:, np.newaxis] if port.type.window is None else np.moveaxis(values, -1, 1)
        each = np.zeros((count, rows, *samples.shape[2:]), values.dtype)
        each[:, row + port.first : row + port.last + 1] = samples
        log[name] = each.reshape(count * rows, *samples.shape[2:])
    return log, row + rows * np.arange(count)


def apply_policy(
    signal: Signal, values: Array, previous: Array, dtype: Dtype
) -> tuple[Array, StatusBit]:
    """The values of an input after the policy of its signal, and the status bits that the policy
    sets. `previous` are the values used in the step before, for policy `hold`; all arrays have the
    type `dtype`.
    """
    low, high, valid = _judged(signal, values, dtype)
    if signal.on_invalid == "trust" or bool(np.all(valid)):
        return values, StatusBit(0)
    not_a_number = StatusBit.NOT_A_NUMBER if bool(np.any(np.isnan(values))) else StatusBit(0)
    match signal.on_invalid:
        case "flag":
            outside = bool(np.any((values < low) | (values > high)))
            return values, not_a_number | (StatusBit.OUT_OF_RANGE if outside else StatusBit(0))
        case "clamp":
            instead = np.dtype(dtype).type(stand_in(signal, dtype))
            # NaN is on neither side: the stand-in takes its place
            nearest = np.where(values > high, high, np.where(values < low, low, instead))
            return np.where(valid, values, nearest), not_a_number | StatusBit.CLAMPED
        case "hold":
            return np.where(valid, values, previous), not_a_number | StatusBit.HELD
        case _:
            assert_never(signal.on_invalid)


def apply_policy_to_window(signal: Signal, rows: Array, dtype: Dtype) -> tuple[Array, StatusBit]:
    """The samples `rows` (time, *shape) of an argument of `reset` after the policy, and the status
    bits. Policy `hold` replaces an invalid sample by the one before.
    """
    checked, bits = rows.copy(), StatusBit(0)
    before = first_held(signal, rows.shape[1:], dtype)
    for k in range(len(rows)):
        before, said = apply_policy(signal, rows[k], before, dtype)
        checked[k], bits = before, bits | said
    return checked, bits


def invalid_samples(signal: Signal, series: Array, dtype: Dtype) -> NDArray[np.bool_]:
    """A mask (runs, steps): True for samples of `series` (runs, steps, *shape) that have an element
    outside the limits of the signal or NaN.
    """
    _, _, valid = _judged(signal, series, dtype)
    return ~np.asarray(valid.all(axis=tuple(range(2, series.ndim))))


def _judged(signal: Signal, values: Array, dtype: Dtype) -> tuple[Any, Any, NDArray[np.bool_]]:
    """The lower and upper limit of valid values of a signal, and the mask of the elements of
    `values` within them.
    """
    low, high = (np.dtype(dtype).type(limit) for limit in limits(signal, dtype))
    # false for NaN
    return low, high, (values >= low) & (values <= high)


def first_held(signal: Signal, shape: tuple[int, ...], dtype: Dtype) -> Array:
    """An array of this shape with the value that policy `hold` uses before the first valid input:
    the valid value nearest to 0.
    """
    return np.full(shape, stand_in(signal, dtype), dtype)


_CHECKED = "checked {}"
"""Names of the checked values that are added to the outputs; no name of a spec contains a space."""


def with_checked(program: Program) -> Program:
    """The program without losses. Additional outputs have the values that generated C checks:
    equations with a range, and saturated states before their limit.
    """
    checked = [
        Output(_CHECKED.format(number), entry.node) for number, entry in enumerate(program.expected)
    ]
    checked += [Output(_CHECKED.format(name), node) for name, node in unsaturated(program).items()]
    return replace(program, losses=(), outputs=(*program.outputs, *checked))


def equation_bits(program: Program, values: Mapping[str, Array], dtype: Dtype) -> StatusBit:
    """The status bit that equations out of their range set, or 0. `values` are outputs of
    `with_checked`.
    """
    outside = [
        _is_outside(values[_CHECKED.format(number)], entry.range, dtype)
        for number, entry in enumerate(program.expected)
    ]
    return StatusBit.EQUATION_OUT_OF_RANGE if any(outside) else StatusBit(0)


def saturation_bits(program: Program, values: Mapping[str, Array]) -> StatusBit:
    """The status bit that states with `on_range: saturate` set if their next value is NaN, or 0.
    `values` are outputs of `with_checked`.
    """
    unordered = [np.isnan(values[_CHECKED.format(name)]).any() for name in unsaturated(program)]
    return StatusBit.STATE_OUT_OF_RANGE if any(unordered) else StatusBit(0)


def first_state_bits(interface: Interface, states: Mapping[str, Array]) -> StatusBit:
    """The status bits that `reset` returns for these initial states (1, *shape) by name. All
    samples of buffers are checked.
    """
    bits = StatusBit(0)
    for check in interface.checks:
        if _is_left(interface, check, states[check.memory.state.name]):
            bits |= check.bit
    return bits


def next_state_bits(interface: Interface, states: Mapping[str, Array]) -> StatusBit:
    """The status bits that a step returns for these next states (B, *shape) by name, of all batch
    members together. Of buffers only the newest sample is checked.
    """
    bits = StatusBit(0)
    for check in interface.checks:
        state = check.memory.state
        values = check.part(states[state.name])
        if state.on_range != "saturate" and _is_left(interface, check, values):
            bits |= check.bit
    return bits


def restarted(
    interface: Interface, states: Mapping[str, Array], first: Mapping[str, Array]
) -> dict[str, Array]:
    """Initial values, by name, of the states with `on_range: reset` that are out of range in
    `states`. `first` has the initial values of all states with `on_range: reset`.
    """
    found: dict[str, Array] = {}
    for check in interface.checks:
        name = check.memory.state.name
        if name in first and _is_left(interface, check, states[name]):
            found[name] = first[name]
    return found


def _is_left(interface: Interface, check: StateCheck, values: Array) -> bool:
    return _is_outside(values, check.limits, interface.options.dtype)


def _is_outside(values: Array, limits: tuple[float, float], dtype: Dtype) -> bool:
    """True if an element is NaN or outside the limits (low, high), which are first rounded to
    `dtype`.
    """
    # as the literals of the C are: what is just beyond a limit in float64 may equal it in float32
    low, high = (np.dtype(dtype).type(limit) for limit in limits)
    return not bool(np.all((values >= low) & (values <= high)))
