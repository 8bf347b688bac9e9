"""Builds an export on this machine: warnings, optimisation levels, sanitizers, shared objects."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import mkdtemp
from threading import Lock

from msnn.verification.exported_c import Sources, includes
from msnn.verification.proof_step import GCC, ProofStep, Result, Tool, ToolFailedError, run_tool

LEVELS = ("-O0", "-O1", "-O2", "-O3", "-Os")
# compilers differ in what they fuse by default
STANDARD = ("-std=c99", "-ffp-contract=off")
SANITIZERS = (
    # an optimiser leaves out what nobody needs, faults too, and most of the build's time is its
    "-O0",
    "-g",
    "-fsanitize=address,undefined,float-cast-overflow",
    # ends the program at the first finding: a message alone would leave its exit code 0
    "-fno-sanitize-recover=all",
)

_FOUND_BY_SANITIZER = re.compile(r"runtime error: |(Address|Leak|UndefinedBehavior)Sanitizer: ?")

Faults = Callable[[Tool, Sequence[str], Path], list[str]]
"""Builds with a compiler and flags in a folder, runs, and returns the faults of self-tests."""


def levels_check(what: str, tool: Tool, faults: Faults, promise: str) -> ProofStep:
    """A check that a program, built at all optimisation levels, computes the expected values.

    `what` is its name, such as "golden steps"; `faults` builds, runs and compares it.
    """

    def run(folder: Path) -> Result:
        found = [
            f"{tool.command} {level}: {fault}"
            for level in LEVELS
            for fault in faults(tool, [level], folder)
        ]
        return check.of(found, f"{what} differ" if found else promise)

    check = ProofStep(what, tool.command, (tool,), run)
    return check


def sanitizers_check(what: str, faults: Faults) -> ProofStep:
    """Runs the same program built by gcc with sanitizers, which stop at undefined behaviour.

    Wrong values are not a finding of this check, but of the check `what`.
    """

    def run(folder: Path) -> Result:
        try:
            found = faults(GCC, SANITIZERS, folder)
        except ToolFailedError as error:
            # a build that fails, or a program that ends by itself, is no finding of a sanitizer
            if any(map(_FOUND_BY_SANITIZER.search, error.lines)):
                return check.of(error.lines, f"a sanitizer stopped {what}")
            return check.of(error.lines, f"{error}, and no sanitizer found anything")
        if found:
            return replace(
                check.of(found, f"{what} differ in a build with sanitizers, which found nothing"),
                check=what,
            )
        return check.of([], "address, undefined behaviour, float-cast-overflow")

    check = ProofStep("sanitizers", GCC.command, (GCC,), run)
    return check


@dataclass(slots=True)
class _Build:
    """The object files of one compiler with one set of flags."""

    lock: Lock = field(default_factory=Lock)
    objects: tuple[Path, ...] = ()


class SharedObjects:
    """Object files of an export, compiled once for all checks that need them."""

    def __init__(self, model: Sources) -> None:
        self._model = model
        self._lock = Lock()
        self._builds: dict[tuple[str, ...], _Build] = {}

    def of(self, tool: Tool, flags: Sequence[str], folder: Path) -> tuple[Path, ...]:
        """The objects, compiled into the folder of the first caller. Raises ToolFailedError."""
        with self._lock:
            build = self._builds.setdefault((tool.command, *flags), _Build())
        # whoever asks second waits for the first instead of compiling as well
        with build.lock:
            if not build.objects:
                sources = self._model.sources
                command = [tool.command, *STANDARD, *flags, *includes(self._model), "-c", *sources]
                # a check builds at several levels in one folder, and names its objects alike
                place = Path(mkdtemp(prefix="objects-", dir=folder))
                run_tool(command, place)
                build.objects = tuple(place / f"{path.stem}.o" for path in sources)
        return build.objects


GCC_WARNINGS = (
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wsign-conversion",
    "-Wdouble-promotion",
    # asked for, as generated code compares floats by < and > alone
    "-Wfloat-equal",
    "-Wshadow",
    "-Wstrict-prototypes",
    "-Wmissing-prototypes",
    "-Wold-style-definition",
    "-Wcast-qual",
    "-Wcast-align",
    "-Wundef",
    "-Wswitch-default",
    "-Wswitch-enum",
    "-Wvla",
    "-Wwrite-strings",
    "-Wlogical-op",
    "-Wduplicated-cond",
    "-Wnull-dereference",
    "-Wunused-macros",
    "-Wredundant-decls",
    "-Wpointer-arith",
    "-Wbad-function-cast",
    "-Wformat=2",
)

CLANG_WARNINGS = (
    "-Weverything",
    "-Wno-declaration-after-statement",  # a C90 rule
    "-Wno-padded",  # where double stands beside uint32_t
    "-Wno-unknown-warning-option",
    "-Wno-unsafe-buffer-usage",  # asks for C++ containers
    "-Wno-switch-default",
    "-Wno-pre-c11-compat",
)

CPP_WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow")
