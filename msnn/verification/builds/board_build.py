"""Compiles sources for a board, links them with start-up code, and runs them in QEMU."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

from msnn.verification.builds.boards import Board
from msnn.verification.builds.harness import TEMPLATES, write_linker_script
from msnn.verification.builds.plugin import instructions_plugin
from msnn.verification.proof_step import run_tool
from msnn.verification.sources import Sources, includes


class BoardBuild:
    """The build of one board and optimisation level in one folder."""

    def __init__(self, board: Board, level: str, model: Sources, folder: Path) -> None:
        self.board, self.folder = board, folder
        self._library: list[Path] = []
        headers = [f"-I{folder}", f"-I{TEMPLATES}"]
        if board.riscv:
            # this gcc comes without a C library; what compilers call by themselves, and sqrt, stand
            # in one file
            self._library = [TEMPLATES / "freestanding" / "library.c"]
            headers += [f"-I{TEMPLATES / 'freestanding'}", "-ffreestanding"]
        self._compiler = [
            board.compiler.command,
            *board.flags,
            "-std=gnu11",
            # no fused multiply-add: the bits of the interpreter round after each operation
            "-ffp-contract=off",
            # lets sqrt be the instruction, which rounds correctly, instead of a call
            "-fno-math-errno",
            # with --gc-sections: what is not called takes no flash, as in a firmware
            "-ffunction-sections",
            "-fdata-sections",
            *includes(model),
            *headers,
        ]
        self._script = write_linker_script(board, folder)
        # at the level that is measured, with its stack use
        flags = [level, "-fcallgraph-info=su"]
        self.objects = [self.object(path, flags) for path in model.sources]

    def object(self, source: Path, flags: Sequence[str], name: str | None = None) -> Path:
        """Compiles one source."""
        result = self.folder / f"{name or source.stem}.o"
        run_tool([*self._compiler, *flags, "-c", source, "-o", result], self.folder)
        return result

    def link(self, name: str, objects: Sequence[Path], options: Sequence[str] = ()) -> Path:
        """Links objects with the start-up code."""
        program = self.folder / f"{name}.elf"
        flags = ["-nostartfiles", "-Wl,--gc-sections", f"-T{self._script}", *options]
        if self.board.riscv:
            # the freestanding library is compiled beside; libgcc has what the core lacks
            flags += ["-nostdlib"]
        libraries = ["-lgcc"] if self.board.riscv else ["-lm"]
        run_tool(
            [*self._compiler, *flags, *objects, *self._start, "-o", program, *libraries],
            self.folder,
        )
        return program

    @cached_property
    def _start(self) -> list[Path]:
        """The objects of the start-up code, shared by all programs of this folder."""
        start = "startup_riscv.c" if self.board.riscv else "startup_arm.c"
        # the loops that are memset and memcpy would be turned into calls of themselves
        flags = ["-O1", "-fno-tree-loop-distribute-patterns"]
        return [self.object(path, flags) for path in (TEMPLATES / start, *self._library)]

    def answer(self, program: Path, seconds: float) -> str:
        """The output of the board; the plugin writes the instruction counts to a file."""
        symbols = run_tool([f"{self.board.binutils}nm", program], self.folder)
        addresses = {line.split()[-1]: line.split()[0] for line in symbols.splitlines()}
        begin, end = (addresses[f"measure_{place}"] for place in ("begin", "end"))
        plugin = str(instructions_plugin(self.folder)).replace(",", ",,")  # as QEMU reads it
        run_tool(
            [
                self.board.emulator.command,
                *("-M", self.board.machine, "-display", "none", "-monitor", "none"),
                # semihosting writes the answer into a file of the host: no device of the board
                # takes part
                *("-serial", "none", "-semihosting-config", "enable=on,target=native"),
                *(("-bios", "none") if self.board.riscv else ()),
                *("-plugin", f"{plugin},begin={begin},end={end},out=counts.txt"),
                *("-kernel", program),
            ],
            self.folder,
            seconds,
        )
        return (self.folder / "result.txt").read_text(encoding="utf-8", errors="replace")

    def counts(self) -> list[int]:
        """Instructions between the two markers, per pass."""
        text = (self.folder / "counts.txt").read_text(encoding="utf-8")
        return [int(line) for line in text.split()]

    def added(self, main: Path) -> tuple[int, int, int]:
        """Flash, .data and .bss in bytes: program with the model minus program without it."""
        full, empty = self._size("full", main, []), self._size("empty", main, ["-DEMPTY"])
        text, data, bss = (a - b for a, b in zip(full, empty, strict=True))
        # initial values of .data lie in flash and are copied to RAM at start
        return text + data, data, bss

    def _size(self, name: str, main: Path, flags: list[str]) -> tuple[int, ...]:
        # the linker keeps what main calls; EMPTY calls nothing of the model
        objects = [self.object(main, ["-Os", *flags], name), *self.objects]
        said = run_tool([f"{self.board.binutils}size", self.link(name, objects)], self.folder)
        return tuple(int(word) for word in said.splitlines()[1].split()[:3])
