"""Runs a contender on a Cortex-M4F in QEMU: instructions, memory, stack, outputs."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from contenders import Contender
from numpy.typing import NDArray

from msnn.verification.boards import BOARDS
from msnn.verification.harness import TEMPLATES, write_linker_script

HARNESS = Path(__file__).parent / "harness"
LEVELS = ("-Os", "-O2", "-O3")
STEPS = 2000
(_BOARD,) = (board for board in BOARDS if board.target == "m4")


@dataclass(frozen=True, slots=True)
class OnBoard:
    """The instructions of a step including its call, and bytes in addition to an empty program."""

    level: str
    least: int
    mean: float
    most: int
    flash: int
    data: int
    bss: int
    stack: int
    outputs: NDArray[np.float32]

    @property
    def ram(self) -> int:
        return self.data + self.bss


def measured(contender: Contender, folder: Path) -> list[OnBoard]:
    """Measures a tool's code at every optimisation level."""
    return [_measured(contender, level, folder / f"board{level}") for level in LEVELS]


def _measured(contender: Contender, level: str, folder: Path) -> OnBoard:
    empty = _build(None, level, folder / "empty")
    full = _build(contender, level, folder / "full")
    idle, nothing = _run(empty)
    counts, results = _run(full)
    own = [count - none for count, none in zip(counts, idle, strict=True)]
    text, data, bss = (a - b for a, b in zip(_size(full), _size(empty), strict=True))
    mean = sum(own) / len(own)
    stack = int(results[STEPS] - nothing[STEPS])
    return OnBoard(level, min(own), mean, max(own), text + data, data, bss, stack, results[:STEPS])


def _build(contender: Contender | None, level: str, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / "board.elf"
    compiler = [_BOARD.compiler.command, *_BOARD.flags, "-std=gnu11", "-ffp-contract=off"]
    compiler += ["-ffunction-sections", "-fdata-sections", f"-I{HARNESS}", f"-I{TEMPLATES}"]
    sources: Sequence[Path] = ()
    if contender is None:
        compiler += ["-DEMPTY"]
    else:
        compiler += [f"-I{path}" for path in (contender.folder, *contender.includes)]
        sources = contender.sources
    objects = [folder / "board.o", folder / "startup.o"]
    for source, made in zip(
        (HARNESS / "board.c", TEMPLATES / "startup_arm.c"), objects, strict=True
    ):
        _tool([*compiler, "-O2", "-c", source, "-o", made])
    for source in sources:
        assert contender is not None
        objects.append(folder / f"{source.stem}.o")
        _tool([*compiler, *contender.flags, level, "-c", source, "-o", objects[-1]])
    link = ["-nostartfiles", "-specs=nosys.specs", "-Wl,--gc-sections,--defsym=end=bss_end"]
    link += [f"-T{write_linker_script(_BOARD, folder)}"]
    _tool([*compiler, *link, *objects, "-o", program, "-lm"])
    return program


def _run(program: Path) -> tuple[list[int], NDArray[np.float32]]:
    """Runs a program; returns the instructions of every step, and the outputs."""
    folder = program.parent
    plugin = folder / "plugin.so"
    _tool(["gcc", "-O1", "-fPIC", "-shared", TEMPLATES / "instructions_plugin.c", "-o", plugin])
    symbols = _tool(["arm-none-eabi-nm", program])
    addresses = {line.split()[-1]: line.split()[0] for line in symbols.splitlines()}
    begin, end = (addresses[f"mark_{place}"] for place in ("begin", "end"))
    machine = ["-M", _BOARD.machine, "-display", "none", "-monitor", "none", "-serial", "none"]
    counting = ["-plugin", f"{plugin},begin={begin},end={end},out=counts.txt"]
    files = ["-semihosting-config", "enable=on,target=native", "-kernel", program]
    _tool(["qemu-system-arm", *machine, *counting, *files], folder)
    counts = [int(line) for line in (folder / "counts.txt").read_text().split()]
    return counts, np.fromfile(folder / "result.txt", np.float32)


def _size(program: Path) -> list[int]:
    """Bytes of a program: code with constants (text), .data and .bss."""
    return [int(n) for n in _tool(["arm-none-eabi-size", program]).splitlines()[1].split()[:3]]


def _tool(command: Sequence[str | Path], folder: Path | None = None) -> str:
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )
    if done.returncode != 0:
        raise RuntimeError(f"{command[0]}: {done.stderr}{done.stdout}")
    return done.stdout
