"""Runs the checks of an export in parallel, and collects their results."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os import cpu_count
from pathlib import Path
from typing import Any, Generic, Literal, Protocol, TypeAlias, TypeVar

from backends.files.atomic_write import write_text
from msnn.errors.commands import not_exported_c
from msnn.exports.export import spare_foreign_files
from msnn.verification.coverage import coverage_check
from msnn.verification.exported_c import ExportedC, Sources, files_check, read_exported_c
from msnn.verification.fuzz import fuzz_check
from msnn.verification.harness import harness_text
from msnn.verification.host_checks import host_checks, misra_check
from msnn.verification.on_board.board_check import board_check
from msnn.verification.on_board.link import DEFAULT_RAM, Link, Ram
from msnn.verification.proof.proof import proof_checks
from msnn.verification.proof_step import ProofStep, Result, Tool
from msnn.verification.qemu import board_checks
from spec_schema import registry
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

Target = Literal["host", "m0", "m4", "m7", "rv32"]
TARGETS: tuple[Target, ...] = ("host", "m4", "m7", "m0", "rv32")


@dataclass(frozen=True, slots=True)
class Verification:
    """The results of all checks of an export, in the order of the checks."""

    model: Sources
    results: tuple[Result, ...]

    @property
    def found(self) -> bool:
        return any(result.verdict == "found" for result in self.results)

    @property
    def missing(self) -> tuple[Tool, ...]:
        tools = (tool for result in self.results for tool in result.missing)
        return tuple(dict.fromkeys(tools))

    @property
    def undone(self) -> bool:
        """True if a check was not completed although its tools are installed."""
        return any(result.verdict == "not done" for result in self.results)

    @property
    def install_line(self) -> str:
        """The line that installs all missing tools."""
        packages = dict.fromkeys(p for tool in self.missing for p in tool.package.split())
        return f"apt-get install {' '.join(packages)}"


def verify(folder: Path, wanted: WantedSteps) -> Verification:
    """Checks the export in a folder; SpecError (E1046) if there is none, E1320 for its board.

    Nothing is written into the folder. Checks with missing tools are part of the results. The board
    is checked first, so that a missing connection is reported immediately.
    """
    asked: tuple[ProofStep, ...] = ()
    kinds = tuple(verified_exports())
    found = next(((kind, own) for kind in kinds if (own := kind.read(folder)) is not None), None)
    if found is not None:
        kind, model = found
        if wanted.board is not None:
            raise SpecError([kind.on_board(model.prefix)])
        own_checks = kind.checks(model, wanted)
    else:
        model = _exported_c(folder, kinds)
        own_checks = _checks(model, wanted)
        if wanted.board is not None:
            asked = (board_check(wanted.board, model, wanted.ram),)
    checks = (files_check(model, model.identities), *own_checks)
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        told = tuple(check.result(place / "board") for check in asked)
        # results keep the order of the checks, whichever thread ends first
        return Verification(model, (*told, *_all_results(checks, place)))


def _exported_c(folder: Path, kinds: Sequence[AnyVerifiedExport]) -> ExportedC:
    try:
        return read_exported_c(folder)
    except SpecError:
        for kind in kinds:
            damaged = kind.damaged_part(folder)
            if damaged is not None:
                raise SpecError([not_exported_c(str(folder), kind.target, damaged)]) from None
        raise


def _all_results(checks: Sequence[ProofStep], place: Path) -> tuple[Result, ...]:
    # threads do: the work is in compilers and emulators, which are processes of their own
    with ThreadPoolExecutor(max_workers=cpu_count() or 1) as pool:
        # a folder for each check: builds of one file name would write over each other
        folders = (place / str(number) for number in range(len(checks)))
        return tuple(pool.map(ProofStep.result, checks, folders))


def _checks(model: ExportedC, wanted: WantedSteps) -> Iterator[ProofStep]:
    if "host" in wanted.targets:
        yield from host_checks(model)
        yield coverage_check(model)
    yield from board_checks(model, wanted.targets)
    if wanted.misra:
        yield misra_check(model)
    if wanted.proof:
        yield from proof_checks(model)
    if wanted.fuzz:
        yield fuzz_check(model, wanted.fuzz)


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedSteps:
    """The checks that the user requests, by options of `msnn verify`."""

    targets: frozenset[str]
    proof: bool = False
    misra: bool = False
    fuzz: int = 0
    """Seconds; 0 for none."""
    board: Link | None = None
    ram: Ram = DEFAULT_RAM
    """Memory of the board."""

    @property
    def is_empty(self) -> bool:
        """True if no check is requested."""
        return not (self.targets or self.proof or self.misra or self.fuzz or self.board)


class IdentifiedSources(Sources, Protocol):
    """A folder with C that states the hashes of its files."""

    @property
    def identities(self) -> Mapping[str, str]:
        """Hashes by pattern of file names."""
        ...


E = TypeVar("E", bound=IdentifiedSources)


@dataclass(frozen=True, kw_only=True)
class VerifiedExport(Generic[E]):
    """A kind of export that a feature verifies by checks of its own."""

    read: Callable[[Path], E | None]
    """The export in a folder; None if the folder has another."""
    damaged_part: Callable[[Path], str | None]
    """The name of a damaged or missing file of such an export; None for other folders."""
    target: str
    """The target of `msnn export`."""
    checks: Callable[[E, WantedSteps], Iterator[ProofStep]]
    on_board: Callable[[str], Diagnostic]
    """The diagnostic if a board should run it; the argument is the prefix of its names."""


AnyVerifiedExport: TypeAlias = VerifiedExport[Any]


def verified_exports() -> Iterator[AnyVerifiedExport]:
    """The kinds of exports defined by features."""
    for line in registry.VERIFIED_EXPORTS:
        kind: AnyVerifiedExport = line.value
        yield kind


def write_serve_files(export: Path, folder: Path) -> tuple[Path, ...]:
    """Writes three C files with which firmware replays golden vectors on a board's serial line.

    Raises SpecError if `export` is no C export (E1046, E1325), or if other files would be replaced
    (E1054).
    """
    for kind in verified_exports():
        if (other := kind.read(export)) is not None:
            raise SpecError([kind.on_board(other.prefix)])
    model = read_exported_c(export)
    names = {
        "replay.h": "replay.h",
        "board_answer.h": "board_answer.h",
        "board_serve.c": f"{model.prefix}_serve.c",
    }
    spare_foreign_files(folder / name for name in names.values())
    return tuple(
        write_text(folder / name, harness_text(template, model)) for template, name in names.items()
    )
