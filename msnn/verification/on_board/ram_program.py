"""Builds the golden vectors as a program that a debugger loads into the RAM of a board."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from msnn.errors.targets.boards import no_room
from msnn.verification.builds.harness import TEMPLATES, write_harness, write_template
from msnn.verification.exported_c import ExportedC
from msnn.verification.on_board.cores import Core
from msnn.verification.on_board.link import Ram
from msnn.verification.proof_step import ToolFailedError, run_tool
from msnn.verification.sources import includes
from msnn.verification.tools import ARM_GCC
from spec_schema.diagnostics.diagnostic import SpecError

_STACK = 4096
_OVERFLOW = re.compile(r"region `ram' overflowed by (\d+) bytes")
_BINUTILS = ARM_GCC.command.removesuffix("gcc")


@dataclass(frozen=True, slots=True)
class RamProgram:
    """Contents from the start of the memory, and the addresses of symbols."""

    data: bytes
    symbols: dict[str, int]


def build_ram_program(
    model: ExportedC, core: Core, level: str, ram: Ram, folder: Path
) -> RamProgram:
    """The program at an optimisation level; SpecError (E1323) if the memory is too small."""
    for name in ("replay.h", "board_answer.h"):
        write_harness(name, model, folder)
    main = write_harness("ram_main.c", model, folder)
    script = write_template(
        "ram.ld", folder, ram_origin=hex(ram.address), ram_length=ram.size, stack=_STACK
    )
    compiler = [
        ARM_GCC.command,
        *core.flags,
        *("-std=gnu11", "-ffp-contract=off", "-fno-math-errno"),
        *("-ffunction-sections", "-fdata-sections"),
        *includes(model),
        *(f"-I{folder}", f"-I{TEMPLATES}"),
    ]
    # startup and harness at -O1 whatever is measured
    sources = [(path, level) for path in model.sources]
    sources += [(main, "-O1"), (TEMPLATES / "startup_arm.c", "-O1")]
    objects: list[Path] = []
    for source, flag in sources:
        # libraries of the compiler for the core's float ABI are found by the flags of the core
        objects.append(folder / f"{source.stem}.o")
        own = (flag, "-fno-tree-loop-distribute-patterns")
        run_tool([*compiler, *own, "-c", source, "-o", objects[-1]], folder)
    program = folder / "ram.elf"
    flags = ["-nostartfiles", "-Wl,--gc-sections", "-Wl,--no-warn-rwx-segments", f"-T{script}"]
    try:
        run_tool([*compiler, *flags, *objects, "-o", program, "-lm"], folder)
    except ToolFailedError as error:
        overflow = next((m for line in error.lines if (m := _OVERFLOW.search(line))), None)
        if overflow is None:
            raise
        needed = ram.size + int(overflow[1])
        raise SpecError([no_room(model.prefix, needed, ram.size)]) from None
    # without gaps: .bss is cleared by the program, so that less is sent over the probe
    run_tool([f"{_BINUTILS}objcopy", "-O", "binary", program, "ram.bin"], folder)
    listed = run_tool([f"{_BINUTILS}nm", program], folder)
    words = [line.split() for line in listed.splitlines()]
    symbols = {name: int(address, 16) for address, _, name in (w for w in words if len(w) == 3)}
    return RamProgram((folder / "ram.bin").read_bytes(), symbols)
