"""Runs the checks of an export side by side and collects what they found."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os import cpu_count
from pathlib import Path
from typing import Literal

from msnn.errors.commands import not_exported_c
from msnn.errors.targets.boards import no_controller_on_board
from msnn.verification.bare_metal import board_checks
from msnn.verification.exported_c import ExportedC, read_exported_c
from msnn.verification.files_check import files_check
from msnn.verification.host.coverage import coverage_check
from msnn.verification.host.fuzz import fuzz_check
from msnn.verification.host.host_checks import host_checks, misra_check
from msnn.verification.on_board.board_check import board_check
from msnn.verification.on_board.link import DEFAULT_RAM, Link, Ram
from msnn.verification.online.board import online_board_checks
from msnn.verification.online.exported_controller import (
    ExportedController,
    damaged_part,
    read_exported_controller,
)
from msnn.verification.online.host import no_proof, online_fuzz_check, online_host_checks
from msnn.verification.proof.proof import proof_checks
from msnn.verification.proof_step import ProofStep, Result
from msnn.verification.sources import Sources
from msnn.verification.tools import Tool
from spec_schema.diagnostics.diagnostic import SpecError

Target = Literal["host", "m0", "m4", "m7", "rv32"]
TARGETS: tuple[Target, ...] = ("host", "m4", "m7", "m0", "rv32")


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedSteps:
    """The checks to make."""

    targets: frozenset[str]
    proof: bool = False
    misra: bool = False
    fuzz: int = 0
    """Seconds; 0 for none."""
    board: Link | None = None
    ram: Ram = DEFAULT_RAM
    """Of the board."""

    @property
    def is_empty(self) -> bool:
        """Whether nothing is to be checked, of which nothing could be found either."""
        return not (self.targets or self.proof or self.misra or self.fuzz or self.board)


@dataclass(frozen=True, slots=True)
class Verification:
    """All results, in the order of the checks."""

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
        """Whether a check was not done though its tools are there."""
        return any(result.verdict == "not done" for result in self.results)

    @property
    def install_line(self) -> str:
        """The line that installs all missing tools."""
        packages = dict.fromkeys(p for tool in self.missing for p in tool.package.split())
        return f"apt-get install {' '.join(packages)}"


def verify(folder: Path, wanted: WantedSteps) -> Verification:
    """Checks the export in a folder; SpecError (E1046) where there is none, E1320 for its board.

    Nothing is written into the folder. What a missing tool would have checked is among the
    results. A board is asked first and alone: nobody shall wait to hear that it is not there.
    """
    model = read_exported_controller(folder) or _exported_c(folder)
    files = files_check(model, model.identities)
    if isinstance(model, ExportedController):
        if wanted.board is not None:
            raise SpecError([no_controller_on_board(model.prefix)])
        checks, asked = (files, *_online_checks(model, wanted)), ()
    else:
        checks = (files, *_checks(model, wanted))
        asked = () if wanted.board is None else (board_check(wanted.board, model, wanted.ram),)
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        told = tuple(check.result(place / "board") for check in asked)
        # results keep the order of the checks, whichever thread ends first
        return Verification(model, (*told, *_all_results(checks, place)))


def _exported_c(folder: Path) -> ExportedC:
    try:
        return read_exported_c(folder)
    except SpecError:
        damaged = damaged_part(folder)
        if damaged is None:
            raise
        raise SpecError([not_exported_c(str(folder), "mpc", damaged)]) from None


def _all_results(checks: Sequence[ProofStep], place: Path) -> tuple[Result, ...]:
    # threads do: the work is in compilers and emulators, which are processes of their own
    with ThreadPoolExecutor(max_workers=cpu_count() or 1) as pool:
        # a folder for each check: builds of one file name would write over each other
        folders = (place / str(number) for number in range(len(checks)))
        return tuple(pool.map(ProofStep.result, checks, folders))


def _online_checks(model: ExportedController, wanted: WantedSteps) -> Iterator[ProofStep]:
    if "host" in wanted.targets:
        yield from online_host_checks(model)
    yield from online_board_checks(model, wanted.targets)
    if wanted.misra:
        yield misra_check(model)
    if wanted.proof:
        yield no_proof(model)
    if wanted.fuzz:
        yield online_fuzz_check(model, wanted.fuzz)


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
