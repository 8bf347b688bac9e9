"""Lists the boards that QEMU emulates, and the compiler options for each."""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass

from msnn.verification.proof_step import ARM_GCC, ARM_QEMU, RISCV_GCC, RISCV_QEMU, Tool


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A processor core that QEMU emulates, with compiler options and the addresses of its
    memory.
    """

    target: str
    """The name in `--targets`."""
    core: str
    machine: str
    flags: tuple[str, ...]
    code: tuple[int, int]
    """Address and size in bytes."""
    ram: tuple[int, int]
    riscv: bool = False

    @property
    def compiler(self) -> Tool:
        return RISCV_GCC if self.riscv else ARM_GCC

    @property
    def emulator(self) -> Tool:
        return RISCV_QEMU if self.riscv else ARM_QEMU

    @property
    def binutils(self) -> str:
        """The prefix of the binutils commands."""
        return self.compiler.command.removesuffix("gcc")


_KIB, _MIB = 1024, 1024 * 1024
_MPS2_CODE, _MPS2_RAM = (0x0, 4 * _MIB), (0x20000000, 4 * _MIB)
_VIRT_CODE, _VIRT_RAM = (0x80000000, 16 * _MIB), (0x81000000, 16 * _MIB)

BOARDS = (
    Board(
        target="m4",
        core="Cortex-M4F",
        machine="mps2-an386",
        flags=("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
        code=_MPS2_CODE,
        ram=_MPS2_RAM,
    ),
    Board(
        target="m7",
        core="Cortex-M7",
        machine="mps2-an500",
        flags=("-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"),
        code=_MPS2_CODE,
        ram=_MPS2_RAM,
    ),
    Board(
        target="m0",
        core="Cortex-M0",
        machine="microbit",
        # no FPU: every operation is a call of libgcc
        flags=("-mcpu=cortex-m0", "-mthumb"),
        code=(0x0, 256 * _KIB),
        ram=(0x20000000, 16 * _KIB),
    ),
    # an explicit _zicsr would make gcc 12 choose the libraries of rv64
    Board(
        target="rv32",
        core="RV32IMAC",
        machine="virt",
        # medany: code at 0x80000000 is beyond the ±2 GiB around 0 that medlow reaches
        flags=("-march=rv32imac", "-mabi=ilp32", "-misa-spec=2.2", "-mcmodel=medany"),
        code=_VIRT_CODE,
        ram=_VIRT_RAM,
        riscv=True,
    ),
    Board(
        target="rv32",
        core="RV32IMAFC",
        machine="virt",
        flags=("-march=rv32imafc", "-mabi=ilp32f", "-misa-spec=2.2", "-mcmodel=medany"),
        code=_VIRT_CODE,
        ram=_VIRT_RAM,
        riscv=True,
    ),
)

LEVELS = ("-O2", "-Os")


def board_levels(targets: Container[str]) -> Iterator[tuple[Board, str]]:
    """Each board of the targets, at each optimisation level."""
    return ((board, level) for board in BOARDS if board.target in targets for level in LEVELS)
