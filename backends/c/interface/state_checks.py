"""Chooses the states that a step checks when it has computed them, and what it reports."""

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
from compiler.ir.liveness import needed_over_time
from compiler.ir.program import Declared, Program, State


def largest(dtype: Dtype) -> float:
    """The largest number of the type."""
    return float(np.finfo(np.float32).max) if dtype == "float32" else sys.float_info.max


@dataclass(frozen=True, slots=True)
class StateCheck:
    """A state whose values are to be within limits, or finite where it has no range."""

    memory: StateMemory
    limits: tuple[float, float]
    bit: StatusBit

    @property
    def place(self) -> ArrayView:
        """The numbers that a step looks at: of a buffer the sample that joined it last."""
        memory = self.memory
        return memory.samples if isinstance(memory, PlainState) else memory.last_sample

    def part(self, value: NDArray[Any]) -> NDArray[Any]:
        """The same of a state's value in numpy."""
        return value if isinstance(self.memory, PlainState) else value[..., -1]


def state_checks(
    program: Program,
    memories: Sequence[StateMemory],
    in_place: Mapping[str, InPlace],
    dtype: Dtype,
) -> tuple[StateCheck, ...]:
    """The checks of declared states, and of all others that could keep a NaN for ever.

    A buffer or memory that does not depend on itself forgets a NaN with its samples.
    """
    found: list[StateCheck] = []
    for memory in memories:
        state = memory.state
        # NaN is outside every range as well: one bit says both
        if isinstance(memory, PlainState) and state.range is not None:
            found.append(StateCheck(memory, state.range, StatusBit.STATE_OUT_OF_RANGE))
        elif isinstance(state.origin, Declared) or _feeds_itself(program, state, in_place):
            # within the largest numbers are exactly the finite ones: no `isfinite` of a C library,
            # whose kind of result C99 leaves open
            finite = (-largest(dtype), largest(dtype))
            found.append(StateCheck(memory, finite, StatusBit.STATE_NOT_FINITE))
    return tuple(found)


def _feeds_itself(program: Program, state: State, in_place: Mapping[str, InPlace]) -> bool:
    buffer = in_place.get(state.name)
    joins = state.next if buffer is None else buffer.newest
    following = {other.name: other.next for other in program.states}
    following[state.name] = joins
    # over all steps, as a value may come back to its state by way of another
    return state.name in needed_over_time(program.step, following, [joins])[1]
