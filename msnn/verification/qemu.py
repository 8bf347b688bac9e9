"""Runs the golden vectors bare-metal in QEMU; measures instructions, memory and stack."""

from __future__ import annotations

import hashlib
import os
import platform
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from statistics import median

from backends.native.kernel_cache import StoredKernel, candidates, opened
from msnn.verification.boards import Board, board_levels
from msnn.verification.exported_c import ExportedC, Sources, includes
from msnn.verification.harness import TEMPLATES, differences, write_harness, write_linker_script
from msnn.verification.proof_step import GCC, Figures, ProofStep, Result, run_tool

_RETURN = 2
"""Instructions with which the empty step returns its status; they count for the model too."""
_SECONDS = 60.0


def board_checks(model: ExportedC, targets: frozenset[str]) -> Iterator[ProofStep]:
    """Checks that replay golden vectors on emulated boards: one per board and optimisation
    level.
    """
    return (_on_board(board, level, model) for board, level in board_levels(targets))


def _on_board(board: Board, level: str, model: ExportedC) -> ProofStep:
    def run(folder: Path) -> Result:
        # the model at the level that is measured; harness and start-up code always at -O1
        build = BoardBuild(board, level, model, folder)
        write_harness("replay.h", model, folder)
        main = build.object(write_harness("board_main.c", model, folder), ["-O1"])
        answer = build.answer(build.link("golden", [main, *build.objects]), _SECONDS)
        found = differences(model, answer)
        stack = re.search(r"stack ([0-9a-f]{8})", answer)
        # without an answer there is nothing to count
        if found or stack is None:
            return check.of(found or ["no word about the stack"], "golden steps differ")
        painted = int(stack[1], 16)
        # of the step alone: init and reset run once, and are not what a task's stack is laid out
        # for
        bound = stack_bound(sorted(folder.glob("*.ci")), f"{model.prefix}_step")
        # painted is what a run has used, the bound what any run can use
        if bound is not None and painted > bound:
            found.append(f"the stack was {painted} bytes deep, the call graph allows {bound}")
        # another program: the harness of the golden steps would count as the model's
        flash, data, bss = build.added(write_harness("size_main.c", model, folder))
        counts = _instructions(build.counts(), model)
        figures = Figures(
            flags=level,
            instructions=(min(counts), sum(counts) / len(counts), max(counts)),
            median=median(counts),
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


def _instructions(counts: list[int], model: ExportedC) -> list[int]:
    """The number of instructions of each step."""
    # the first count is of an empty step: call, loop and reading of the counter
    idle, *rest = counts
    return [count - idle + _RETURN for count in rest[: len(model.expected)]]


class BoardBuild:
    """Compiles and runs programs for one board at one optimisation level, in one folder."""

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
        """Compiles one C source, and returns the object file."""
        result = self.folder / f"{name or source.stem}.o"
        run_tool([*self._compiler, *flags, "-c", source, "-o", result], self.folder)
        return result

    def link(self, name: str, objects: Sequence[Path], options: Sequence[str] = ()) -> Path:
        """Links objects with the start-up code of the board, and returns the program."""
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
        """Runs a program in QEMU, and returns its output; a plugin writes instruction counts to a
        file.
        """
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


_NODE = re.compile(r'node: \{ title: "([^"]+)" label: "([^"]*)"')
_EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
# "dynamic" without a bound does not match: such a function has no known need
_BYTES = re.compile(r"(\d+) bytes \((static|dynamic,bounded)\)")
_WITHOUT_STACK = ("memcpy", "memset", "memmove")
"""Routines that the compiler inserts for copies; leaf functions with a few words of stack."""
_LEAF = 16


def stack_bound(graphs: Sequence[Path], function: str) -> int | None:
    """Stack of `function` in bytes, including all functions that it calls.

    None for recursion, or if it calls a library routine with unknown stack.
    """
    text = "\n".join(path.read_text(encoding="utf-8") for path in graphs)
    own = {
        _plain(title): int(stated[1])
        for title, label in _NODE.findall(text)
        if (stated := _BYTES.search(label))
    }
    own |= dict.fromkeys(_WITHOUT_STACK, _LEAF)
    calls: dict[str, set[str]] = {}
    for caller, called in _EDGE.findall(text):
        calls.setdefault(_plain(caller), set()).add(_plain(called))

    def depth(name: str, above: tuple[str, ...]) -> int | None:
        # calls through pointers go to a node `__indirect_call` of no size, and end here too
        if name in above or name not in own:
            return None
        below = [depth(called, (*above, name)) for called in sorted(calls.get(name, ()))]
        # frames of callees never stand on the stack together
        known = [bytes for bytes in below if bytes is not None]
        return own[name] + max(known, default=0) if len(known) == len(below) else None

    return depth(function, ())


def _plain(title: str) -> str:
    """The name of a function; gcc prefixes static functions by their file."""
    return title.rsplit(":", 1)[-1]


_SOURCE = TEMPLATES / "instructions_plugin.c"
_FLAGS = ("-O1", "-fPIC", "-shared")


def instructions_plugin(folder: Path) -> Path:
    """The library of the plugin: from the cache, or built in `folder` without a usable cache.

    A comparison of models measures the C code of each; the cache avoids compiling the plugin each
    time.
    """
    # caches lie on shared disks, where another machine may run
    described = "\n".join((_SOURCE.read_text(encoding="utf-8"), *_FLAGS, platform.machine()))
    key = hashlib.sha256(described.encode()).hexdigest()[:32]
    for place in candidates():
        with suppress(OSError):  # full or closed
            real, reason = opened(place)
            # QEMU maps the library executable, which a file system mounted noexec refuses
            if reason is None and not os.statvfs(real).f_flag & os.ST_NOEXEC:
                stored = StoredKernel(real, key)
                if stored.whole() is None:
                    stored.built(_build)
                return stored.library
    library = folder / "instructions_plugin.so"
    _build(library, folder)
    return library


def _build(library: Path, folder: Path) -> None:
    run_tool([GCC.command, *_FLAGS, _SOURCE, "-o", library], folder)
