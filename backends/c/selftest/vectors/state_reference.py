"""Checks states and equations in NumPy: the reference for the checks in generated C."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from backends.c.interface.state_checks import StateCheck
from backends.c.interface.status import StatusBit
from backends.c_language.literals import Dtype
from compiler.ir.program import Output, Program
from compiler.passes.analyses.saturation import unsaturated

Array = NDArray[Any]

_CHECKED = "checked {}"
"""Names of the checked values that are added to the outputs; no name of a spec contains a space."""


def with_checked(program: Program) -> Program:
    """The program without losses, with the checked values as additional outputs."""
    checked = [
        Output(_CHECKED.format(number), entry.node) for number, entry in enumerate(program.expected)
    ]
    checked += [Output(_CHECKED.format(name), node) for name, node in unsaturated(program).items()]
    return replace(program, losses=(), outputs=(*program.outputs, *checked))


def equation_bits(program: Program, values: Mapping[str, Array], dtype: Dtype) -> StatusBit:
    """The status bit of equations out of range; `values` are the outputs of `with_checked`."""
    outside = [
        _is_outside(values[_CHECKED.format(number)], entry.range, dtype)
        for number, entry in enumerate(program.expected)
    ]
    return StatusBit.EQUATION_OUT_OF_RANGE if any(outside) else StatusBit(0)


def saturation_bits(program: Program, values: Mapping[str, Array]) -> StatusBit:
    """The status bit of saturated states that keep their value because the next one is NaN."""
    unordered = [np.isnan(values[_CHECKED.format(name)]).any() for name in unsaturated(program)]
    return StatusBit.STATE_OUT_OF_RANGE if any(unordered) else StatusBit(0)


def first_state_bits(interface: Interface, states: Mapping[str, Array]) -> StatusBit:
    """The status bits of the states set by `reset`, including all samples of buffers."""
    bits = StatusBit(0)
    for check in interface.checks:
        if _is_left(interface, check, states[check.memory.state.name]):
            bits |= check.bit
    return bits


def next_state_bits(interface: Interface, states: Mapping[str, Array]) -> StatusBit:
    """The status bits of the states after a step; of buffers only the newest sample is checked."""
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
    """The states with `on_range: reset` that are out of range, with their first values."""
    found: dict[str, Array] = {}
    for check in interface.checks:
        name = check.memory.state.name
        if name in first and _is_left(interface, check, states[name]):
            found[name] = first[name]
    return found


def _is_left(interface: Interface, check: StateCheck, values: Array) -> bool:
    return _is_outside(values, check.limits, interface.options.dtype)


def _is_outside(values: Array, limits: tuple[float, float], dtype: Dtype) -> bool:
    """True if an element is out of range or NaN; limits are rounded to the type of the values."""
    # as the literals of the C are: what is just beyond a limit in float64 may equal it in float32
    low, high = (np.dtype(dtype).type(limit) for limit in limits)
    return not bool(np.all((values >= low) & (values <= high)))
