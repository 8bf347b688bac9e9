"""Changes of a kernel's C that change no answer, each with the reason."""

from __future__ import annotations

from benchmarks.mutation.mutants import Mutant

KERNEL_EQUIVALENTS: dict[str, dict[tuple[str, str], str]] = {}
"""By model: the line and the change."""


def kernel_reason(name: str, mutant: Mutant) -> str | None:
    """Why a change changes no answer; None where it is not known to be so."""
    return KERNEL_EQUIVALENTS.get(name, {}).get((mutant.line, mutant.change))
