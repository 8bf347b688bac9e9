"""Builds the golden vectors as a program for the RAM of a board, and runs it by a debugger."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from msnn.errors.targets import no_room, refused_memory, silent
from msnn.verification.exported_c import ExportedC, includes
from msnn.verification.harness import TEMPLATES, write_harness, write_template
from msnn.verification.on_board.debugger import Debugger, RefusedMemoryError
from msnn.verification.on_board.link import Ram
from msnn.verification.proof_step import ARM_GCC, ToolFailedError, run_tool
from spec_schema.diagnostics.diagnostic import SpecError

_STACK = 4096
_OVERFLOW = re.compile(r"region `ram' overflowed by (\d+) bytes")
_BINUTILS = ARM_GCC.command.removesuffix("gcc")


@dataclass(frozen=True, slots=True)
class RamProgram:
    """A test program as bytes of the memory, and the addresses of its symbols."""

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


_SECONDS = 60.0
"""Maximum time between two output buffers; a replay takes at most a second on slow cores."""
_THUMB = 0x01000000
"""The Thumb bit of xPSR, which a Cortex-M requires."""


def run_in_ram(board: Debugger, program: RamProgram, link: str, begin: int) -> str:
    """Runs a program; SpecError if its memory cannot be written (E1322) or the core hangs
    (E1321).
    """
    places = program.symbols
    stops = [places[name] for name in ("hand_over", "finished", "trap")]
    text: list[bytes] = []
    try:
        board.load(begin, program.data)
        board.break_at(stops)
        board.set_register("sp", places["stack_top"])
        # a core halted in a fault handler would go on as one: the exception number is 0 now as well
        board.set_register("xpsr", _THUMB)
        board.set_register("pc", places["start"] & ~1)
        while (at := board.run(_SECONDS)) == places["hand_over"] & ~1:
            letters = board.read_word(places["handed_letters"])
            text.append(board.read(places["handed_text"], letters))
            # returns from the function that stands at the breakpoint: none of its code is needed
            board.set_register("pc", board.register("lr") & ~1)
        # not after a failure: a core that ended somewhere else is reset by its owner
        board.go_by(stops)
    except RefusedMemoryError as error:
        raise SpecError([refused_memory(link, error.address)]) from None
    except TimeoutError:
        raise SpecError([silent(link, f"the core ran {_SECONDS:g} s without a word")]) from None
    if at != places["finished"] & ~1:
        raise SpecError([silent(link, f"the core trapped: it stands at 0x{at:08x}")])
    return b"".join(text).decode("ascii", "replace")


CPUID, FPU_FEATURES = 0xE000ED00, 0xE000EF40
"""Register addresses: core identity (CPUID), floating-point features (MVFR0)."""


@dataclass(frozen=True, slots=True)
class Core:
    """An ARM core and the options of gcc for it."""

    name: str
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Family:
    name: str
    cpu: str
    single: str | None = None
    """The single-precision FPU option."""
    double: str | None = None
    """The double-precision FPU option."""


_FAMILIES = {
    0xC20: _Family("Cortex-M0", "cortex-m0"),
    0xC60: _Family("Cortex-M0+", "cortex-m0plus"),
    0xC23: _Family("Cortex-M3", "cortex-m3"),
    0xC24: _Family("Cortex-M4", "cortex-m4", "fpv4-sp-d16"),
    0xC27: _Family("Cortex-M7", "cortex-m7", "fpv5-sp-d16", "fpv5-d16"),
    0xD20: _Family("Cortex-M23", "cortex-m23"),
    0xD21: _Family("Cortex-M33", "cortex-m33", "fpv5-sp-d16"),
}
"""Cores by the part number in CPUID, from their technical reference manuals."""


def core_of(identity: int, fpu: int) -> Core | None:
    """The core with this CPUID and MVFR0 (`fpu`); None if it is unknown."""
    # PARTNO of CPUID; variant and revision around it do not matter to a compiler
    family = _FAMILIES.get((identity >> 4) & 0xFFF)
    if family is None:
        return None
    # MVFR0: fields of single and of double precision, 0 for none
    single, double = bool((fpu >> 4) & 0xF), bool((fpu >> 8) & 0xF)
    unit = (family.double if double else None) or (family.single if single else None)
    own = ("-mfloat-abi=soft",) if unit is None else ("-mfloat-abi=hard", f"-mfpu={unit}")
    return Core(
        family.name if unit is None else f"{family.name} with FPU",
        (f"-mcpu={family.cpu}", "-mthumb", *own),
    )
