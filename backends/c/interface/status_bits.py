"""Finds which status bits a model can return: the header declares these and no others."""

from __future__ import annotations

from backends.c.interface.interface import Interface
from backends.c.interface.status import SelfTest, Status
from compiler.ir.program import InvalidPolicy

_OF_POLICY: dict[InvalidPolicy, Status] = {
    "flag": Status.OUT_OF_RANGE | Status.NOT_A_NUMBER,
    "clamp": Status.CLAMPED | Status.NOT_A_NUMBER,
    "hold": Status.HELD | Status.NOT_A_NUMBER,
    "trust": Status(0),
}


def step_bits(interface: Interface) -> list[Status]:
    """Bits of what step, reset and linearize return."""
    bits = Status(0)
    for port in (*(i.port for i in interface.inputs), *(port for _, port in interface.windows)):
        bits |= _OF_POLICY[port.signal.on_invalid]
    for check in interface.checks:
        bits |= check.bit
    if interface.checks_equations:
        bits |= Status.EQUATION_OUT_OF_RANGE
    if interface.has_state:
        bits |= Status.UNINITIALISED
    if interface.jacobian is not None and any(
        field.matrix.perhaps_infinite for field in interface.jacobian.fields
    ):
        bits |= Status.SLOPE_NOT_FINITE
    return list(bits)


def selftest_bits(*, has_kernels: bool, has_helpers: bool, calibrates: bool) -> list[SelfTest]:
    """Bits of the self-test's result; helpers are the sample time and what copies structs."""
    there = {
        SelfTest.KERNEL_DIFFERS: has_kernels,
        SelfTest.HELPER_DIFFERS: has_helpers,
        SelfTest.CHECKSUM_DIFFERS: calibrates,
    }
    return [bit for bit in SelfTest if there.get(bit, True)]
