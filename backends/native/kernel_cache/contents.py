"""Says what a folder of kernels holds, and throws away what is old or nobody's."""

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
"""Seconds after which a file without a kernel is one that a process left when it was killed."""

_OF_KERNELS = re.compile(r"\.?(?:build-)?([0-9a-f]{32})[.-].*")
"""Names of files and folders of a cache: others are left alone, wherever MSNN_CACHE leads to."""


@dataclass(frozen=True, slots=True)
class KeptKernel:
    """A kernel's files, their bytes, and when one of them was written or the kernel was loaded."""

    files: tuple[Path, ...]
    size: int
    used: float


@dataclass(frozen=True, slots=True)
class CacheLimits:
    """The age and size of what may stay; None for no limit. `days=0` keeps nothing."""

    days: float | None = None
    """Since a kernel was used, by the day."""
    megabytes: float | None = None
    """Of all kernels together; those that were used last stay."""


def kept_kernels(folder: Path) -> list[KeptKernel]:
    """The kernels in a folder, the one that was used last first."""
    # MSNN_CACHE may lead to a folder with somebody's other libraries: nothing of theirs is counted
    # or removed
    keys = {path.stem for path in folder.glob("*.so") if _OF_KERNELS.fullmatch(path.name)}
    return sorted((_kernel(folder, key) for key in keys), key=lambda kernel: -kernel.used)


def clean(folder: Path, limits: CacheLimits) -> Sequence[KeptKernel]:
    """Removes kernels beyond the limits and what killed processes left; the kernels removed.

    A kernel that another process has loaded stays in its memory.
    """
    now, room = time.time(), _bytes(limits.megabytes)
    removed: list[KeptKernel] = []
    for kernel in kept_kernels(folder):
        # the newest first, so that what is beyond the limit was used longest ago
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
            # of a link itself: whatever it leads to is not ours
            found = path.lstat()
            files.append(path)
            size, used = size + found.st_size, max(used, found.st_mtime)
    return KeptKernel(tuple(files), size, used)


def _left_over(folder: Path, now: float) -> list[Path]:
    """The remains of builds that never ended, and notes on kernels that are gone."""
    left: list[Path] = []
    for path in folder.iterdir():
        named = _OF_KERNELS.fullmatch(path.name)
        if named is None:
            continue
        # notes live as long as their kernel; locks and folders of builds only as long as somebody
        # builds
        lasting = not path.name.startswith(".") and path.suffix != ".lock"
        if lasting and (folder / f"{named[1]}.so").exists():
            continue
        with suppress(OSError):
            if now - path.lstat().st_mtime > _UNDER_WAY:
                left.append(path)
    return left
