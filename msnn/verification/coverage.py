"""Reports the lines and branches of the model that golden vectors and self-test execute."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msnn.verification.exported_c import ExportedC, includes
from msnn.verification.proof_step import GCC, GCOV, ProofStep, Result, ToolFailedError, run_tool


@dataclass(frozen=True, slots=True)
class Unreached:
    """A source line that is not executed, or the number of its branches that are not taken."""

    file: str
    function: str
    text: str
    branches: int
    """0 if the line itself is not executed."""

    def __str__(self) -> str:
        what = (
            f"{self.branches} {'branch' if self.branches == 1 else 'branches'}"
            if self.branches
            else "line"
        )
        return f"{self.file}: {self.function}: {what} not reached: {self.text}"


@dataclass(frozen=True, slots=True)
class SourceCoverage:
    """The executed fractions of lines and branches of all sources, and the code that is not
    reached.
    """

    lines: int
    branches: int
    unreached: tuple[Unreached, ...]

    @property
    def lines_reached(self) -> int:
        return self.lines - sum(not place.branches for place in self.unreached)

    @property
    def branches_reached(self) -> int:
        return self.branches - sum(place.branches for place in self.unreached)


def coverage_check(model: ExportedC) -> ProofStep:
    """A check that reports code of the export that its tests do not reach, as notes.

    It is no finding: clamping may make a branch unreachable.
    """

    def run(folder: Path) -> Result:
        found = coverage(model, folder)
        detail = (
            f"{found.lines_reached} of {found.lines} lines, "
            f"{found.branches_reached} of {found.branches} branches by golden steps and self-test"
        )
        return check.of([], detail, notes=[str(place) for place in found.unreached])

    check = ProofStep("coverage", "gcc", (GCC, GCOV), run)
    return check


def coverage(model: ExportedC, folder: Path) -> SourceCoverage:
    """Runs the test program of an export; gcov writes into `folder`."""
    tests = sorted((model.folder / "test").glob("*.c"))
    # -O0: an optimiser merges branches, and what is counted would no longer be the lines of the
    # source
    flags = ["-std=c99", "-O0", "-ffp-contract=off", "--coverage"]
    sources = [*model.sources, *tests]
    run_tool([GCC.command, *flags, *includes(model), *sources, "-o", "covered", "-lm"], folder)
    with suppress(ToolFailedError):  # other checks say that golden steps differ
        run_tool([folder / "covered"], folder)
    lines = [line for path in model.model_sources for line in _lines(path, folder)]
    return SourceCoverage(
        lines=len(lines),
        branches=sum(len(line["branches"]) for _, _, line in lines),
        unreached=tuple(_unreached(lines)),
    )


_Line = tuple[Path, str, dict[str, Any]]


def _lines(source: Path, folder: Path) -> Iterator[_Line]:
    """Each source line with code, with the counts of gcov."""
    # gcc names it after the program where several sources are compiled and linked at once
    data = folder / f"covered-{source.stem}.gcda"
    if not data.exists():
        return
    options = ["--branch-probabilities", "--json-format", "--stdout"]
    text = source.read_text(encoding="utf-8").splitlines()
    for file in json.loads(run_tool([GCOV.command, *options, data], folder))["files"]:
        # headers with code are listed as well
        if Path(file["file"]).name == source.name:
            for line in file["lines"]:
                number = int(line["line_number"])
                yield source, text[number - 1].strip(), line


def _unreached(lines: list[_Line]) -> Iterator[Unreached]:
    for path, text, line in lines:
        function = str(line["function_name"])
        if not line["count"]:
            yield Unreached(path.name, function, text, 0)
        # a line that is never reached has branches without a count: both are told
        missed = sum(not branch["count"] for branch in line["branches"])
        if missed:
            yield Unreached(path.name, function, text, missed)
