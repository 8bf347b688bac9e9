"""Chooses the checks that a step runs on its computed states, and the status bit of each."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.status import StatusBit
from backends.c_language.literals import Dtype
from backends.c_language.places import ArrayView
from backends.c_lowering.state_memory import InPlace, PlainState, StateMemory
from compiler.ir.nodes import needed_over_time
from compiler.ir.program import Declared, Program, State


def largest(dtype: Dtype) -> float:
    """The largest finite value of the type."""
    return float(np.finfo(np.float32).max) if dtype == "float32" else sys.float_info.max


@dataclass(frozen=True, slots=True)
class StateCheck:
    """Checks that a state lies within its range, or is finite if it has no range."""

    memory: StateMemory
    limits: tuple[float, float]
    bit: StatusBit

    @property
    def place(self) -> ArrayView:
        """The elements that the step checks: the whole state, or the newest sample of a buffer."""
        memory = self.memory
        return memory.samples if isinstance(memory, PlainState) else memory.last_sample

    def part(self, value: NDArray[Any]) -> NDArray[Any]:
        """The same elements of a NumPy value of the state; the last axis of a buffer is time."""
        return value if isinstance(self.memory, PlainState) else value[..., -1]


def state_checks(
    program: Program,
    memories: Sequence[StateMemory],
    in_place: Mapping[str, InPlace],
    dtype: Dtype,
) -> tuple[StateCheck, ...]:
    """Checks of all declared states, and of other states that could keep a NaN for ever.

    A buffer or memory that does not depend on itself drops a NaN together with its samples.
    """
    found: list[StateCheck] = []
    for memory in memories:
        state = memory.state
        # NaN is outside every range as well, so one bit covers both cases
        if isinstance(memory, PlainState) and state.range is not None:
            found.append(StateCheck(memory, state.range, StatusBit.STATE_OUT_OF_RANGE))
        elif isinstance(state.origin, Declared) or _feeds_itself(program, state, in_place):
            # a comparison with the largest finite values replaces `isfinite`: C99 does not fix
            # the type of its result
            finite = (-largest(dtype), largest(dtype))
            found.append(StateCheck(memory, finite, StatusBit.STATE_NOT_FINITE))
    return tuple(found)


def _feeds_itself(program: Program, state: State, in_place: Mapping[str, InPlace]) -> bool:
    buffer = in_place.get(state.name)
    joins = state.next if buffer is None else buffer.newest
    following = {other.name: other.next for other in program.states}
    following[state.name] = joins
    # over all steps: a value may return to its state through another state
    return state.name in needed_over_time(program.step, following, [joins])[1]
