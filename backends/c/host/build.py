"""Builds generated C with a compiler of this machine and calls it from numpy."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from backends.files.c_compiler import find_compiler
from backends.files.run_compiler import CompilerTooSlowError, run_compiler


class CompilerFailedError(Exception):
    """The compiler rejected the sources or hung; `output` is what it wrote, or how long it had."""

    def __init__(self, command: Sequence[str], output: str) -> None:
        super().__init__(f"{shlex.join(command)}\n{output}")
        self.output = output


def build_library(
    folder: Path,
    library: Path,
    compiler: Sequence[str] | None = None,
    flags: Sequence[str] = ("-O2",),
) -> Path:
    """Compiles the sources of a folder that `write_c` wrote into a shared library; its path.

    Raises CompilerMissingError and CompilerFailedError.
    """
    sources = sorted(str(path) for path in (folder / "src").glob("*.c"))
    return compile_with(
        [*(compiler or find_compiler()), "-std=c99", *flags, "-ffp-contract=off", "-fPIC"],
        ["-shared", f"-I{folder / 'include'}", *sources],
        library,
    )


def build_test(
    folder: Path,
    program: Path,
    compiler: Sequence[str] | None = None,
    flags: Sequence[str] = ("-O2",),
) -> Path:
    """Compiles sources and test program of a folder into an executable; its path."""
    sources = sorted(str(path) for part in ("src", "test") for path in (folder / part).glob("*.c"))
    return compile_with(
        [*(compiler or find_compiler()), "-std=c99", *flags, "-ffp-contract=off"],
        [f"-I{folder / 'include'}", *sources],
        program,
    )


def compile_with(head: Sequence[str], arguments: Sequence[str], result: Path) -> Path:
    """The file that a compiler with its flags makes of the arguments.

    Raises CompilerFailedError with what it said, also where it takes too long.
    """
    command = [*head, *arguments, "-o", str(result), "-lm"]
    try:
        done = run_compiler(command)
    except CompilerTooSlowError as error:
        raise CompilerFailedError(command, f"it {error}") from None
    if done.code != 0:
        raise CompilerFailedError(command, done.errors + done.output)
    return result
