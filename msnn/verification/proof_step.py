"""Runs one check with its tools, and records its result."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Literal

from backends.files.c_compiler import complaints


@dataclass(frozen=True, slots=True)
class Tool:
    """A command that a check needs, or a file for another command, and its Debian package."""

    command: str
    package: str

    @property
    def is_there(self) -> bool:
        if self is LIBFUZZER:
            return _has_libfuzzer()
        return shutil.which(self.command) is not None


GCC = Tool("gcc", "gcc")
GCOV = Tool("gcov", "gcc")
GPP = Tool("g++", "g++")
NM = Tool("nm", "binutils")
CLANG = Tool("clang", "clang")
CPPCHECK = Tool("cppcheck", "cppcheck")
FRAMA_C = Tool("frama-c", "frama-c-base")
ARM_GCC = Tool("arm-none-eabi-gcc", "gcc-arm-none-eabi libnewlib-arm-none-eabi")
ARM_QEMU = Tool("qemu-system-arm", "qemu-system-arm")
RISCV_GCC = Tool("riscv64-unknown-elf-gcc", "gcc-riscv64-unknown-elf")
RISCV_QEMU = Tool("qemu-system-riscv32", "qemu-system-misc")
OPENOCD = Tool("openocd", "openocd")
PYOCD = Tool("pyocd", "python3-pyocd")
# no command: a library of clang, which Debian packs apart, by its version
LIBFUZZER = Tool("libFuzzer", "libclang-rt-14-dev")


@cache
def _has_libfuzzer() -> bool:
    if not CLANG.is_there:
        return False
    asked = ["clang", "-print-resource-dir"]
    found = subprocess.run(asked, capture_output=True, text=True, check=False)
    return any(Path(found.stdout.strip()).glob("lib/**/libclang_rt.fuzzer-*.a"))


Verdict = Literal["ok", "found", "missing", "left out", "not done"]
"""`left out` means the check is unnecessary; `not done` means a tool gave no answer."""

_SECONDS = 300.0
"""Timeout of a tool."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Measured instructions, memory and stack of one build of a function, on one board."""

    flags: str
    of: str = ""
    """Name of the function if it is not the step."""
    instructions: tuple[int, float, int]
    """Minimum, mean and maximum per call."""
    median: float
    """Median of instructions per call."""
    flash: int
    data: int
    bss: int
    stack_painted: int
    stack_bound: int | None
    """From the call graph; None if a library routine has unknown stack."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """The result of one check on one target."""

    check: str
    target: str
    verdict: Verdict
    detail: str
    findings: tuple[str, ...] = ()
    figures: tuple[Figures, ...] = ()
    missing: tuple[Tool, ...] = ()
    notes: tuple[str, ...] = ()
    """Further observations."""
    cycles: tuple[int, float, int] | None = None
    """Minimum, mean and maximum cycles of a step, on a physical board with a counter."""


@dataclass(frozen=True, slots=True)
class ProofStep:
    """One check of an export, which is run in a folder of its own."""

    name: str
    target: str
    needs: tuple[Tool, ...]
    run: Callable[[Path], Result] = field(repr=False)

    def result(self, folder: Path) -> Result:
        """Runs the check; a missing, failing or hanging tool becomes a verdict, not an
        exception.
        """
        missing = tuple(tool for tool in self.needs if not tool.is_there)
        if missing:
            # a verdict of its own: "ok" would claim what nobody looked at
            names = ", ".join(tool.command for tool in missing)
            detail = f"{names} not installed"
            return Result(
                check=self.name,
                target=self.target,
                verdict="missing",
                detail=detail,
                missing=missing,
            )
        # a new folder each time: a file that a former run has left would be taken for this one's
        folder.mkdir(parents=True)
        try:
            return self.run(folder)
        # a tool that hangs or is ended says nothing about the code, one that fails does
        except UnansweredError as error:
            return Result(
                check=self.name, target=self.target, verdict="not done", detail=str(error)
            )
        except ToolFailedError as error:
            return Result(
                check=self.name,
                target=self.target,
                verdict="found",
                detail=str(error),
                findings=tuple(error.lines),
            )

    def of(
        self,
        findings: Sequence[str],
        detail: str,
        figures: Sequence[Figures] = (),
        notes: Sequence[str] = (),
        cycles: tuple[int, float, int] | None = None,
    ) -> Result:
        """A result of this check with these findings; none means that it passed."""
        return Result(
            check=self.name,
            target=self.target,
            verdict="found" if findings else "ok",
            detail=detail,
            findings=tuple(findings),
            figures=tuple(figures),
            notes=tuple(notes),
            cycles=cycles,
        )


class ToolFailedError(Exception):
    """A command failed; `lines` are its output."""

    def __init__(self, what: str, output: str) -> None:
        super().__init__(what)
        # a compiler that stumbles once goes on for thousands of lines; the first ones say it
        self.lines = [line for line in output.splitlines() if line.strip()][:40]

    @property
    def complaints(self) -> list[str]:
        """The lines that contain an error; all lines if none does."""
        return complaints("\n".join(self.lines)) or self.lines or [str(self)]


class UnansweredError(Exception):
    """A command ended without a result about the code, for example because it ran out of time."""


class ToolTimedOutError(UnansweredError):
    """A command timed out."""


def run_tool(command: Sequence[str | Path], folder: Path, seconds: float = _SECONDS) -> str:
    """Runs a command in `folder` for at most `seconds`, and returns its output.

    Raises ToolFailedError if it fails, and ToolTimedOutError.
    """
    words = [str(word) for word in command]
    try:
        done = subprocess.run(
            words,
            cwd=folder,
            # a tool that asks a question ends instead of waiting for an answer
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            # sanitizers print bytes of the memory that they complain about, which need not be text
            errors="replace",
            check=False,
            timeout=seconds,
        )
    except subprocess.TimeoutExpired:
        raise ToolTimedOutError(f"no answer within {seconds:g} s: {words[0]}") from None
    output = done.stdout + done.stderr
    if done.returncode != 0:
        raise ToolFailedError(f"{words[0]} failed", f"{shlex.join(words)}\n{output}")
    return output
