"""Checks on this machine: strict builds, static analysis, golden vectors, sanitizers."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from msnn.verification.exported_c import ExportedC, Sources, includes
from msnn.verification.harness import differences, write_harness
from msnn.verification.host_builds import (
    CLANG_WARNINGS,
    CPP_WARNINGS,
    GCC_WARNINGS,
    LEVELS,
    STANDARD,
    levels_check,
    sanitizers_check,
)
from msnn.verification.proof_step import (
    CLANG,
    CPPCHECK,
    GCC,
    GPP,
    NM,
    ProofStep,
    Result,
    Tool,
    ToolFailedError,
    run_tool,
)


def host_checks(model: ExportedC) -> Iterator[ProofStep]:
    """The checks of an export that run on this machine with gcc and clang; together they take
    seconds.
    """
    yield from source_checks(model)

    def faults(tool: Tool, flags: Sequence[str], folder: Path) -> list[str]:
        return differences(model, _replay(tool.command, flags, model, folder))

    bits = "0 bits differ" if model.exact else "within the tolerance"
    promise = f"{len(model.expected)} golden steps at {' '.join(LEVELS)}: {bits}"
    for tool in (GCC, CLANG):
        yield levels_check("golden vectors", tool, faults, promise)
    yield sanitizers_check("golden vectors", faults)


def source_checks(model: Sources, accepted: Sequence[str] = ()) -> Iterator[ProofStep]:
    """Checks of C sources by compilers: no warnings except `accepted` ones, and no static
    variables.
    """
    gcc, clang = [*GCC_WARNINGS, *accepted], [*CLANG_WARNINGS, *accepted]
    yield _compiling("warnings", "gcc", (GCC,), model, [*STANDARD, "-O2", *gcc])
    # clang warns of what it reads, at no level of what its optimiser finds, as gcc has just done
    yield _compiling("warnings", "clang", (CLANG,), model, [*STANDARD, "-fsyntax-only", *clang])
    # headers and sources are also to be compiled as C++, as many firmwares do
    cpp = ["-x", "c++", "-std=c++17", "-ffp-contract=off", "-fsyntax-only", *CPP_WARNINGS]
    yield _compiling("warnings", "g++", (GPP,), model, cpp)
    yield _compiling("analyzer", "gcc", (GCC,), model, [*STANDARD, "-O1", "-fanalyzer"])
    yield _memory(model)


MISRA = ("--addon=misra", f"--addon-python={sys.executable}", "-U__clang__")
"""Options of cppcheck; the addon runs in the Python of msnn, which saves a search per file.

`-U__clang__` avoids reading each file twice for a pragma of clang.
"""


def misra_check(model: Sources) -> ProofStep:
    """The check of the sources by cppcheck's MISRA addon, for a subset of MISRA C:2012.

    The tool does not run here, only when the returned step is run.
    """

    def run(folder: Path) -> Result:
        # findings of the addon are of the severity style
        # else its temporary files appear beside the sources, where the check of files sees them
        temporary = folder / "misra"
        temporary.mkdir()
        build = f"--cppcheck-build-dir={temporary}"
        options = ["-q", *MISRA, "--std=c99", "--enable=style", build]
        said = run_tool(
            [
                CPPCHECK.command,
                *options,
                "--template={file}:{line} {severity} {id}",
                f"-I{model.include}",
                *model.sources,
            ],
            folder,
        )
        # it ends with 0 all the same
        if "internal error" in said:
            raise ToolFailedError(f"{CPPCHECK.command} could not run its MISRA addon", said)
        found = [
            f"{place.removeprefix(f'{model.folder}/')} {what}"
            for place, severity, what in _TOLD_BY_CPPCHECK.findall(said)
            # cppcheck itself says other things of style, which are not the question; after an error
            # it leaves the rest of a file unread
            if "misra-c2012" in what or severity == "error"
        ]
        version = run_tool([CPPCHECK.command, "--version"], folder).strip()
        return check.of(found, f"{len(found)} findings by the MISRA addon of {version}")

    check = ProofStep("misra", "source", (CPPCHECK,), run)
    return check


def _compiling(
    name: str, target: str, needs: tuple[Tool, ...], model: Sources, flags: list[str]
) -> ProofStep:
    """A check that compiles the sources and fails at any warning."""

    def run(folder: Path) -> Result:
        tests = sorted((model.folder / "test").glob("*.c"))
        said = run_tool([target, *flags, *includes(model), "-c", *model.sources, *tests], folder)
        # read, not made errors by -Werror: all of them are wanted at once
        found = [line for line in said.splitlines() if "warning:" in line]
        shown = [line.removeprefix(f"{model.folder}/") for line in found]
        count = len([flag for flag in flags if flag.startswith("-W")])
        what = f"{count} warning flags" if count else "-fanalyzer"
        return check.of(shown, f"{len(found)} warnings, {what}")

    check = ProofStep(name, target, needs, run)
    return check


_TOLD_BY_CPPCHECK = re.compile(r"^(.*:\d+) (\w+) (\S+)$", re.MULTILINE)
"""Matches place, severity and identifier of a finding."""

_WRITABLE = re.compile(r"^(\S+?):.* [bBcCdDgGsS] (\S+)$", re.MULTILINE)
"""Matches output of nm: object file and symbol of variables in .bss, .data or common."""


def writable_objects(sources: Sequence[Path], options: Sequence[str], folder: Path) -> list[str]:
    """Static variables of the sources, as `file: name`."""
    # -O0: an object that an optimiser would drop is memory in the source all the same
    run_tool([GCC.command, *STANDARD, "-O0", *options, "-c", *sources], folder)
    objects = [f"{path.stem}.o" for path in sources]
    said = run_tool([NM.command, "-A", *objects], folder)
    return [f"{file.removesuffix('.o')}.c: {name}" for file, name in _WRITABLE.findall(said)]


def _memory(model: Sources) -> ProofStep:
    """Checks that instances are independent: all memory must be in structs passed by the caller."""

    def run(folder: Path) -> Result:
        all = writable_objects(model.model_sources, includes(model), folder)
        # a tool changes it at run time, so that it has to be one object at a fixed address
        found = [line for line in all if line.rpartition(": ")[2] != model.calibration]
        wanted = " but the parameters for calibration" if len(found) < len(all) else ""
        return check.of(found, f"{len(found)} objects that all instances would share{wanted}")

    check = ProofStep("memory", "gcc", (GCC, NM), run)
    return check


def _replay(compiler: str, flags: Sequence[str], model: ExportedC, folder: Path) -> str:
    write_harness("replay.h", model, folder)
    main = write_harness("host_main.c", model, folder)
    program = folder / "replay"
    command = [compiler, *STANDARD, *flags, *includes(model), f"-I{folder}", main]
    run_tool([*command, *model.sources, "-o", program, "-lm"], folder)
    return run_tool([program], folder)
