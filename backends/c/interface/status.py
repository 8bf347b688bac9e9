"""Defines the status bits of generated functions, and the checks of states that set them."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c_language.literals import Dtype
from backends.c_language.places import ArrayView
from backends.c_lowering.state_memory import InPlace, PlainState, StateMemory
from compiler.ir.nodes import needed_over_time
from compiler.ir.program import Declared, Program, State


class StatusBit(IntFlag):
    """Status bits of step, reset and linearize, explained in MEANING; 0 means that no check
    failed.
    """

    # deployed code relies on these values: new bits may be added, none may change
    OUT_OF_RANGE = 1
    NOT_A_NUMBER = 2
    CLAMPED = 4
    HELD = 8
    STATE_OUT_OF_RANGE = 16
    UNINITIALISED = 32
    EQUATION_OUT_OF_RANGE = 64
    STATE_NOT_FINITE = 128
    SLOPE_NOT_FINITE = 8192  # equals SelfTestBit.CHECKSUM_DIFFERS: no result has both


class SelfTestBit(IntFlag):
    """Status bits of the self-test, explained in MEANING; 0 means that it passed."""

    STEP_DIFFERS = 256
    KERNEL_DIFFERS = 512
    CONTRACTED = 1024
    NO_SUBNORMALS = 2048
    HELPER_DIFFERS = 4096
    CHECKSUM_DIFFERS = 8192
    REORDERED = 16384


MEANING: dict[StatusBit | SelfTestBit, str] = {
    StatusBit.OUT_OF_RANGE: "an input was outside its range and was used as it is",
    StatusBit.NOT_A_NUMBER: "an input was NaN",
    StatusBit.CLAMPED: "an input was moved to the nearest limit, NaN to the valid value nearest to "
    "0",
    StatusBit.HELD: "an input was replaced by its last valid value",
    StatusBit.STATE_OUT_OF_RANGE: "a state left its range",
    StatusBit.UNINITIALISED: "neither init nor reset was called, or a state waits for reset",
    StatusBit.EQUATION_OUT_OF_RANGE: "an equation was outside its range",
    StatusBit.STATE_NOT_FINITE: "a state without a range is NaN or infinite; init or reset ends "
    "that",
    StatusBit.SLOPE_NOT_FINITE: "a slope that linearize gave is infinite or NaN",
    SelfTestBit.STEP_DIFFERS: "a golden step gave other numbers",
    SelfTestBit.KERNEL_DIFFERS: "a mathematical function gave other numbers",
    SelfTestBit.CONTRACTED: "the compiler fuses multiplications with additions",
    SelfTestBit.NO_SUBNORMALS: "the processor flushes subnormal numbers to zero",
    SelfTestBit.REORDERED: "the compiler changes the order of sums, or multiplies by reciprocals "
    "instead of dividing",
    SelfTestBit.HELPER_DIFFERS: "a vector held other numbers than its struct, or the sample time "
    "is another",
    SelfTestBit.CHECKSUM_DIFFERS: "the values for calibration are not those of their checksum",
}


def status_macro(prefix: str, bit: StatusBit | SelfTestBit) -> str:
    """The name of the C macro of a bit, such as `VEH_STATUS_CLAMPED` or `VEH_SELFTEST_STEP_DIFFERS`
    for prefix `veh`.
    """
    assert bit.name is not None
    kind = "STATUS" if isinstance(bit, StatusBit) else "SELFTEST"
    return f"{prefix.upper()}_{kind}_{bit.name}"


def largest(dtype: Dtype) -> float:
    """The largest finite value of the type."""
    return float(np.finfo(np.float32).max) if dtype == "float32" else sys.float_info.max


@dataclass(frozen=True, slots=True)
class StateCheck:
    """A check of a state in the C code: sets `bit` if an element is NaN or outside `limits` (low,
    high), which are the largest finite values for a state without range.
    """

    memory: StateMemory
    limits: tuple[float, float]
    bit: StatusBit

    @property
    def place(self) -> ArrayView:
        """The elements that the step checks: the whole state, or the newest sample of a buffer."""
        memory = self.memory
        return memory.samples if isinstance(memory, PlainState) else memory.last_sample

    def part(self, value: NDArray[Any]) -> NDArray[Any]:
        """The elements of a NumPy value of the state that the step checks: all, or the newest
        sample of a buffer, whose last axis is time.
        """
        return value if isinstance(self.memory, PlainState) else value[..., -1]


def state_checks(
    program: Program,
    memories: Sequence[StateMemory],
    in_place: Mapping[str, InPlace],
    dtype: Dtype,
) -> tuple[StateCheck, ...]:
    """The checks of all declared states, and of other states that could keep a NaN for ever because
    they depend on themselves. `memories` are the states in C, and `in_place` has those that C
    stores as buffers, by name. Other buffers are unchecked: they drop a NaN together with its
    sample.
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
