"""Runs the golden vectors bare-metal in QEMU; counts instructions, memory and stack."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from msnn.verification.builds.boards import BOARDS, Board
from msnn.verification.builds.call_graph import stack_bound
from msnn.verification.builds.golden_run import differences
from msnn.verification.builds.harness import TEMPLATES, includes, write_harness, write_linker_script
from msnn.verification.exported_c import ExportedC
from msnn.verification.proof_step import Figures, ProofStep, Result, run_tool
from msnn.verification.tools import GCC

LEVELS = ("-O2", "-Os")
_RETURN = 2
"""Instructions in which the empty step returns its status: they are the model's as well."""
_SECONDS = 60.0


def board_checks(model: ExportedC, targets: frozenset[str]) -> Iterator[ProofStep]:
    """One check for each board and optimisation level."""
    for board in BOARDS:
        if board.target in targets:
            for level in LEVELS:
                yield _on_board(board, level, model)


def _on_board(board: Board, level: str, model: ExportedC) -> ProofStep:
    def run(folder: Path) -> Result:
        build = _Build(board, level, model, folder)
        program = build.program()
        answer = build.answer(program)
        found = differences(model, answer)
        stack = re.search(r"stack ([0-9a-f]{8})", answer)
        if found or stack is None:
            return check.of(found or ["no word about the stack"], "golden steps differ")
        painted = int(stack[1], 16)
        bound = stack_bound(sorted(folder.glob("*.ci")), f"{model.prefix}_step")
        if bound is not None and painted > bound:
            found.append(f"the stack was {painted} bytes deep, the call graph allows {bound}")
        flash, data, bss = build.sizes()
        figures = Figures(
            flags=level,
            instructions=build.instructions(),
            flash=flash,
            data=data,
            bss=bss,
            stack_painted=painted,
            stack_bound=bound,
        )
        promise = "0 bits differ" if model.exact else "within the tolerance"
        return check.of(found, f"{len(model.expected)} golden steps: {promise}", [figures])

    needs = (board.compiler, board.emulator, GCC)
    check = ProofStep("golden vectors", f"{board.core} {level}", needs, run)
    return check


class _Build:
    """The files of one board and level in one folder."""

    def __init__(self, board: Board, level: str, model: ExportedC, folder: Path) -> None:
        self.board, self.level, self.model, self.folder = board, level, model, folder
        self._library: list[Path] = []
        headers = [f"-I{folder}", f"-I{TEMPLATES}"]
        if board.riscv:
            self._library = [TEMPLATES / "freestanding" / "library.c"]
            headers += [f"-I{TEMPLATES / 'freestanding'}", "-ffreestanding"]
        self._compiler = [
            board.compiler.command,
            *board.flags,
            "-std=gnu11",
            "-ffp-contract=off",
            "-fno-math-errno",
            "-ffunction-sections",
            "-fdata-sections",
            *includes(model),
            *headers,
        ]
        self._script = write_linker_script(board, folder)
        self._objects = self._model_objects()

    def _model_objects(self) -> list[Path]:
        """The model at the level that is measured, with its stack use."""
        flags = [self.level, "-fcallgraph-info=su"]
        return [self._object(path, flags) for path in self.model.sources]

    def _object(self, source: Path, flags: list[str], name: str | None = None) -> Path:
        result = self.folder / f"{name or source.stem}.o"
        run_tool([*self._compiler, *flags, "-c", source, "-o", result], self.folder)
        return result

    def _link(self, name: str, objects: list[Path]) -> Path:
        start = "startup_riscv.c" if self.board.riscv else "startup_arm.c"
        harness = [TEMPLATES / start, *self._library]
        others = [
            self._object(path, ["-O1", "-fno-tree-loop-distribute-patterns"]) for path in harness
        ]
        program = self.folder / f"{name}.elf"
        flags = ["-nostartfiles", "-Wl,--gc-sections", f"-T{self._script}"]
        if self.board.riscv:
            flags += ["-nostdlib"]
        libraries = ["-lgcc"] if self.board.riscv else ["-lm"]
        run_tool(
            [*self._compiler, *flags, *objects, *others, "-o", program, *libraries], self.folder
        )
        return program

    def program(self) -> Path:
        """The golden vectors, linked."""
        write_harness("replay.h", self.model, self.folder)
        main = write_harness("board_main.c", self.model, self.folder)
        return self._link("golden", [self._object(main, ["-O1"]), *self._objects])

    def answer(self, program: Path) -> str:
        """What the board wrote; the plugin leaves the counts of instructions in a file."""
        symbols = run_tool([f"{self.board.binutils}nm", program], self.folder)
        addresses = {line.split()[-1]: line.split()[0] for line in symbols.splitlines()}
        begin, end = (addresses[f"measure_{place}"] for place in ("begin", "end"))
        plugin = self.folder / "instructions_plugin.so"
        source = TEMPLATES / "instructions_plugin.c"
        run_tool([GCC.command, "-O1", "-fPIC", "-shared", source, "-o", plugin], self.folder)
        run_tool(
            [
                self.board.emulator.command,
                *("-M", self.board.machine, "-display", "none", "-monitor", "none"),
                *("-serial", "none", "-semihosting-config", "enable=on,target=native"),
                *(("-bios", "none") if self.board.riscv else ()),
                *("-plugin", f"{plugin},begin={begin},end={end},out=counts.txt"),
                *("-kernel", program),
            ],
            self.folder,
            _SECONDS,
        )
        return (self.folder / "result.txt").read_text(encoding="utf-8", errors="replace")

    def instructions(self) -> tuple[int, float, int]:
        """Of a step: least, mean and most."""
        text = (self.folder / "counts.txt").read_text(encoding="utf-8")
        counts = [int(line) for line in text.split()]
        idle, *rest = counts
        own = [count - idle + _RETURN for count in rest[: len(self.model.expected)]]
        return min(own), sum(own) / len(own), max(own)

    def sizes(self) -> tuple[int, int, int]:
        """Flash, .data and .bss of a program with the model less those of one without."""
        full, empty = self._size("full", []), self._size("empty", ["-DEMPTY"])
        text, data, bss = (a - b for a, b in zip(full, empty, strict=True))
        return text + data, data, bss

    def _size(self, name: str, flags: list[str]) -> tuple[int, ...]:
        main = write_harness("size_main.c", self.model, self.folder)
        objects = [self._object(main, ["-Os", *flags], name), *self._objects]
        said = run_tool([f"{self.board.binutils}size", self._link(name, objects)], self.folder)
        return tuple(int(word) for word in said.splitlines()[1].split()[:3])
