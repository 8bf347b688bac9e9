"""Defines the status bits of `step`, `reset` and `selftest`, which a safety layer may evaluate."""

from __future__ import annotations

from enum import IntFlag


class StatusBit(IntFlag):
    """Status bits of step, reset and linearize; 0 means that no check failed."""

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
    """Status bits of the self-test; 0 means that it passed."""

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
    """The C macro of a status bit, such as `VEH_STATUS_CLAMPED`."""
    assert bit.name is not None
    kind = "STATUS" if isinstance(bit, StatusBit) else "SELFTEST"
    return f"{prefix.upper()}_{kind}_{bit.name}"
