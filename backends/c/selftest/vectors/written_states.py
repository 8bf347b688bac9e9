"""Chooses state values that a test program writes, since no start reaches them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from backends.c.interface.interface import Field, Interface
from backends.c.interface.state_checks import StateCheck
from backends.c.interface.status import StatusBit
from backends.c.selftest.vectors.drawn_inputs import outside
from backends.c_lowering.state_memory import PlainState

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class WrittenNumber:
    """A value of one element of a state before the first step."""

    state: str
    element: int
    value: float

    def into(self, states: Mapping[str, Array]) -> dict[str, Array]:
        """The states, (1, *shape) each, with this value inserted."""
        changed = states[self.state].copy()
        changed.reshape(-1)[self.element] = self.value
        return {**states, self.state: changed}


def written_states(interface: Interface) -> list[WrittenNumber]:
    """Written values that each trigger exactly one check of a step's states.

    A state with a constant start may need many steps to reach its limit, and one without a range is
    infinite only after an error.
    """
    return [written for check in interface.checks for written in _of(check, interface)]


def state_fields(interface: Interface) -> list[Field]:
    """The fields of the state struct that have the shape of their states."""
    return [
        Field(
            name=memory.state.name,
            identifier=memory.identifier,
            axes=memory.state.axes,
            unit=memory.state.unit,
            comment="",
        )
        for memory in interface.states
        if isinstance(memory, PlainState)
    ]


def _of(check: StateCheck, interface: Interface) -> Iterator[WrittenNumber]:
    if not isinstance(check.memory, PlainState):
        return
    size = math.prod(check.memory.shape)
    # above `unroll` a loop looks at them: its first and last turn show where it begins and ends
    elements = range(size) if size <= interface.options.unroll else (0, size - 1)
    sides = _sides(check)
    for number, element in enumerate(elements):
        # elements share one check: each way to be outside once, in turn, shows it, and that each is
        # looked at; what is unrolled may look at NaN in one of them and not in another
        chosen = sides if size == 1 else [sides[number % len(sides)]] if sides else []
        for value in (*chosen, math.nan):
            yield WrittenNumber(check.memory.state.name, element, value)


def _sides(check: StateCheck) -> list[float]:
    """Up to two finite values outside the limits; infinity for a check of finiteness only."""
    if check.bit == StatusBit.STATE_NOT_FINITE:
        return [math.inf]
    found = [outside(check.limits, end) for end in ("above", "far below")]
    return [value for value in found if math.isfinite(value)]
