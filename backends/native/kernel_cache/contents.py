"""Lists the kernels in a folder, and removes old and orphaned files."""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_A_DAY = 86_400.0
_UNDER_WAY = 3600.0
"""Seconds after which a file without a kernel is considered left by a killed process."""

_OF_KERNELS = re.compile(r"\.?(?:build-)?([0-9a-f]{32})[.-].*")
"""Names of cache files and folders; all others are ignored, wherever MSNN_CACHE points."""


@dataclass(frozen=True, slots=True)
class KeptKernel:
    """A kernel's files, their size in bytes, and the time of its latest use."""

    files: tuple[Path, ...]
    size: int
    used: float


@dataclass(frozen=True, slots=True)
class CacheLimits:
    """Limits on age and size of the cache; None for no limit. `days=0` removes all kernels."""

    days: float | None = None
    """Maximum days since the latest use."""
    megabytes: float | None = None
    """Maximum size of all kernels; the most recently used ones stay."""


def kept_kernels(folder: Path) -> list[KeptKernel]:
    """The kernels in a folder, most recently used first."""
    # MSNN_CACHE may be a folder with other libraries, which are neither counted nor removed
    keys = {path.stem for path in folder.glob("*.so") if _OF_KERNELS.fullmatch(path.name)}
    return sorted((_kernel(folder, key) for key in keys), key=lambda kernel: -kernel.used)


def clean(folder: Path, limits: CacheLimits) -> Sequence[KeptKernel]:
    """Removes kernels beyond the limits and files of killed processes; returns the removed kernels.

    A kernel that another process has loaded stays in its memory.
    """
    now, room = time.time(), _bytes(limits.megabytes)
    removed: list[KeptKernel] = []
    for kernel in kept_kernels(folder):
        # newest first, so that the least recently used ones exceed the limit
        room -= kernel.size
        too_old = limits.days is not None and now - kernel.used >= limits.days * _A_DAY
        if too_old or room < 0:
            removed.append(kernel)
            for file in kernel.files:
                file.unlink(missing_ok=True)
    for left in _left_over(folder, now):
        if left.is_dir() and not left.is_symlink():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)
    return removed


def _bytes(megabytes: float | None) -> float:
    return float("inf") if megabytes is None else megabytes * 1e6


def _kernel(folder: Path, key: str) -> KeptKernel:
    files: list[Path] = []
    size, used = 0, 0.0
    for suffix in (".so", ".sha256", ".checked"):
        path = folder / f"{key}{suffix}"
        with suppress(OSError):
            # lstat: the target of a link is not ours
            found = path.lstat()
            files.append(path)
            size, used = size + found.st_size, max(used, found.st_mtime)
    return KeptKernel(tuple(files), size, used)


def _left_over(folder: Path, now: float) -> list[Path]:
    """Remains of interrupted builds, and notes of removed kernels."""
    left: list[Path] = []
    for path in folder.iterdir():
        named = _OF_KERNELS.fullmatch(path.name)
        if named is None:
            continue
        # notes last as long as their kernel; locks and build folders only during a build
        lasting = not path.name.startswith(".") and path.suffix != ".lock"
        if lasting and (folder / f"{named[1]}.so").exists():
            continue
        with suppress(OSError):
            if now - path.lstat().st_mtime > _UNDER_WAY:
                left.append(path)
    return left
