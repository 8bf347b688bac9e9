"""Defines a kind of export, besides the C of a model, that `msnn verify` checks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

from msnn.verification.on_board.link import DEFAULT_RAM, Link, Ram
from msnn.verification.proof_step import ProofStep
from msnn.verification.sources import Sources
from spec_schema import registry
from spec_schema.diagnostics.diagnostic import Diagnostic


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedSteps:
    """The requested checks."""

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
    """A kind of export with its own checks."""

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
