"""Finds installed dependencies, commands that install missing ones, and the cache of kernels."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from backends.files.c_compiler import CompilerMissingError, find_compiler
from backends.native.kernel_cache import (
    CacheLimits,
    KeptKernel,
    KernelFolder,
    cache_folder,
    clean,
    kept_kernels,
    kernel_folder,
)
from msnn.errors.learning.engines import foreign_folder_is_not_cleaned
from msnn.packages import OPTIONAL, ZIGLANG
from msnn.simulation.engines.open_rollouts import kernel_folder_warnings
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.plugins import Plugins
from spec_schema.version import __version__


@dataclass(frozen=True)
class InstalledPart:
    """A dependency of msnn: its purpose, the installed version, and the command that
    installs it.
    """

    name: str
    purpose: str
    found: str | None
    install: str | None = None


def installation() -> Iterator[InstalledPart]:
    """Every dependency, found without importing it."""
    yield InstalledPart("msnn", "", __version__)
    yield InstalledPart(
        "python", "", f"{platform.python_version()} on {platform.platform(terse=True)}"
    )
    yield _compiler()
    yield InstalledPart("numpy", "arithmetic", _version("numpy"))
    for package in OPTIONAL:
        yield InstalledPart(package.name, package.purpose, _version(package.name), package.install)


def plugin_parts(plugins: Plugins) -> Iterator[InstalledPart]:
    """The installed plug-ins of msnn, each with what it brings."""
    for plugin in plugins.found:
        brings = ", ".join(f"{kind} {name}" for kind, name in sorted(plugin.keys))
        yield InstalledPart(plugin.package, f"plug-in: {brings or 'nothing'}", plugin.version)


def plugin_values(plugins: Plugins) -> list[dict[str, Any]]:
    """The plug-ins as JSON: package, version, and kind and name of all that each brings."""
    return [
        {
            "package": plugin.package,
            "version": plugin.version,
            "brings": [{"kind": kind, "name": name} for kind, name in sorted(plugin.keys)],
        }
        for plugin in plugins.found
    ]


def _compiler() -> InstalledPart:
    purpose = "native training kernels, tests of exported C"
    try:
        command = find_compiler()
    except CompilerMissingError:
        return InstalledPart("C compiler", purpose, None, f"apt install gcc, or {ZIGLANG.install}")
    return InstalledPart("C compiler", purpose, " ".join(command))


def _version(package: str) -> str | None:
    try:
        # from the metadata: importing torch to ask it takes seconds
        return version(package)
    except PackageNotFoundError:
        return None


@dataclass(frozen=True, slots=True)
class KernelCache:
    """The folder of compiled kernels: its path, the reason if it is not the preferred one, its
    files.
    """

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
        """A warning if the preferred folder of compiled kernels cannot be used."""
        return kernel_folder_warnings(self.taken)

    def values(self) -> dict[str, Any]:
        """The folder and its kernels as a JSON object."""
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
