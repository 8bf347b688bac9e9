"""Runs the self-tests of an export at every optimisation level, and under sanitizers."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from msnn.verification.proof_step import ProofStep, Result, ToolFailedError
from msnn.verification.tools import GCC, Tool

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
    """Checks that `what`, such as "golden steps", gives equal results at all levels."""

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
