"""Which status bits a model can return: the header declares these and no others."""

from __future__ import annotations

from backends.c.interface.interface import Interface
from backends.c.interface.status import SelfTest, Status
from backends.c_lowering.state_memory import PlainState
from compiler.ir.program import InvalidPolicy

_OF_POLICY: dict[InvalidPolicy, Status] = {
    "flag": Status.OUT_OF_RANGE | Status.NOT_A_NUMBER,
    "clamp": Status.CLAMPED | Status.NOT_A_NUMBER,
    "hold": Status.HELD | Status.NOT_A_NUMBER,
    "trust": Status(0),
}


def step_bits(interface: Interface) -> list[Status]:
    """Bits of the step's result."""
    bits = Status(0)
    for input in interface.inputs:
        bits |= _OF_POLICY[input.port.signal.on_invalid]
    for memory in interface.states:
        if isinstance(memory, PlainState) and memory.state.range is not None:
            bits |= Status.STATE_OUT_OF_RANGE
    if interface.checks_equations:
        bits |= Status.EQUATION_OUT_OF_RANGE
    if interface.from_record:
        bits |= Status.UNINITIALISED
    return list(bits)


def selftest_bits(*, has_kernels: bool, has_helpers: bool) -> list[SelfTest]:
    """Bits of the self-test's result; helpers are the sample time and what copies structs."""
    there = {SelfTest.KERNEL_DIFFERS: has_kernels, SelfTest.HELPER_DIFFERS: has_helpers}
    return [bit for bit in SelfTest if there.get(bit, True)]
