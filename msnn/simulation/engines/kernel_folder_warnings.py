"""Warns if kernels are stored in another folder than requested."""

from __future__ import annotations

from backends.native.kernel_cache import KernelFolder
from msnn.errors.learning.kernels import foreign_kernels, unusable_kernel_folder
from spec_schema.diagnostics.diagnostic import Diagnostic


def kernel_folder_warnings(found: KernelFolder) -> tuple[Diagnostic, ...]:
    """The warning; empty if the requested folder is used."""
    refused = found.refused
    if refused is None:
        return ()
    # a folder in which others write is no place to load code from (decision 0183)
    of = foreign_kernels if refused.is_foreign else unusable_kernel_folder
    return (of(refused.folder, refused.reason, found.path),)
