"""Finds the status bits that a model can return: the header declares only these."""

from __future__ import annotations

from backends.c.interface.interface import Interface
from backends.c.interface.status import SelfTestBit, StatusBit
from compiler.ir.program import InvalidPolicy

_OF_POLICY: dict[InvalidPolicy, StatusBit] = {
    "flag": StatusBit.OUT_OF_RANGE | StatusBit.NOT_A_NUMBER,
    "clamp": StatusBit.CLAMPED | StatusBit.NOT_A_NUMBER,
    "hold": StatusBit.HELD | StatusBit.NOT_A_NUMBER,
    "trust": StatusBit(0),
}


def step_bits(interface: Interface) -> list[StatusBit]:
    """The bits that step, reset and linearize of this model can return."""
    bits = StatusBit(0)
    for port in (*(i.port for i in interface.inputs), *(port for _, port in interface.windows)):
        bits |= _OF_POLICY[port.signal.on_invalid]
    for check in interface.checks:
        bits |= check.bit
    if interface.checks_equations:
        bits |= StatusBit.EQUATION_OUT_OF_RANGE
    if interface.has_state:
        bits |= StatusBit.UNINITIALISED
    if interface.jacobian is not None and any(
        field.matrix.perhaps_infinite for field in interface.jacobian.fields
    ):
        bits |= StatusBit.SLOPE_NOT_FINITE
    return list(bits)


def selftest_bits(*, has_kernels: bool, has_helpers: bool, calibrates: bool) -> list[SelfTestBit]:
    """The bits that the self-test can return.

    The helpers are the sample time and the functions that copy between vectors and structs.
    """
    there = {
        SelfTestBit.KERNEL_DIFFERS: has_kernels,
        SelfTestBit.HELPER_DIFFERS: has_helpers,
        SelfTestBit.CHECKSUM_DIFFERS: calibrates,
    }
    return [bit for bit in SelfTestBit if there.get(bit, True)]
