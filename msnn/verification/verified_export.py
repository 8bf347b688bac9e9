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


class IdentifiedSources(Sources, Protocol):
    """A folder with C that names the hashes of its files."""

    @property
    def identities(self) -> Mapping[str, str]:
        """Hashes, by a pattern of the files that they are of."""
        ...


E = TypeVar("E", bound=IdentifiedSources)


@dataclass(frozen=True, kw_only=True)
class VerifiedExport(Generic[E]):
    """A kind of export with checks of its own."""

    read: Callable[[Path], E | None]
    """The export in a folder; None if the folder has another."""
    damaged_part: Callable[[Path], str | None]
    """The name of a damaged or missing file of such an export; None if the folder has another."""
    target: str
    """The target of `msnn export` that writes it."""
    checks: Callable[[E, WantedSteps], Iterator[ProofStep]]
    on_board: Callable[[str], Diagnostic]
    """The refusal, by the prefix of its names, where a board is asked to run it."""


AnyVerifiedExport: TypeAlias = VerifiedExport[Any]


def verified_exports() -> Iterator[AnyVerifiedExport]:
    """The kinds that features bring."""
    for line in registry.VERIFIED_EXPORTS:
        kind: AnyVerifiedExport = line.value
        yield kind
