"""Describes the cache of compiled kernels, and cleans it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from backends.native.kernel_cache import (
    CacheLimits,
    KeptKernel,
    KernelFolder,
    cache_folder,
    clean,
    kept_kernels,
    kernel_folder,
)
from msnn.errors.learning.kernels import foreign_folder_is_not_cleaned
from msnn.simulation.engines.kernel_folder_warnings import kernel_folder_warnings
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError


@dataclass(frozen=True, slots=True)
class KernelCache:
    """The cache folder in use, the reason if it is not the preferred one, and its kernels."""

    taken: KernelFolder
    kernels: Sequence[KeptKernel]

    @property
    def text(self) -> str | None:
        """The folder and its contents in one line; None if no folder can be used."""
        if self.taken.path is None:
            return None
        return f"{self.taken.path} (trusted; {_size(self.kernels)})"

    @property
    def warnings(self) -> tuple[Diagnostic, ...]:
        """A warning if another folder was preferred."""
        return kernel_folder_warnings(self.taken)

    def values(self) -> dict[str, Any]:
        """The same as JSON."""
        refused = self.taken.refused
        return {
            "folder": None if self.taken.path is None else str(self.taken.path),
            "kernels": len(self.kernels),
            "bytes": _bytes(self.kernels),
            "refused": None
            if refused is None
            else {
                "folder": str(refused.folder),
                "reason": refused.reason,
                "trusted": not refused.is_foreign,
            },
        }


def kernel_cache() -> KernelCache:
    """The currently cached kernels."""
    taken = kernel_folder()
    return KernelCache(taken, [] if taken.path is None else kept_kernels(taken.path))


def cleaned_cache(limits: CacheLimits) -> str:
    """Cleans the preferred folder, even if it is full; returns a text about removed files.

    Raises SpecError if other users may write to it, because the files may be theirs.
    """
    refused = kernel_folder().refused
    # the wanted folder, though another is taken because it is full: that is when one cleans
    folder = cache_folder()
    if refused is not None and refused.is_foreign:
        raise SpecError((foreign_folder_is_not_cleaned(folder, refused.reason),))
    removed = clean(folder, limits) if folder.is_dir() else ()
    return f"removed {_size(removed)}, from {folder}"


def _size(kernels: Sequence[KeptKernel]) -> str:
    count = len(kernels)
    return f"{count} kernel{'' if count == 1 else 's'}, {_bytes(kernels) / 1e6:.1f} MB"


def _bytes(kernels: Sequence[KeptKernel]) -> int:
    return sum(kernel.size for kernel in kernels)
