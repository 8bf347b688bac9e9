"""Chooses the folder in which kernels are kept: the wanted one, else one of the user alone."""

from __future__ import annotations

import errno
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from backends.files.run_compiler import has_room
from backends.native.kernel_cache.trust import why_folder_is_not_trusted


@dataclass(frozen=True, slots=True)
class Refusal:
    """A folder that was wanted and cannot be taken, and why."""

    folder: Path
    reason: str
    is_foreign: bool
    """Others could have put kernels into it; else it is only full or closed."""


@dataclass(frozen=True, slots=True)
class KernelFolder:
    """The folder in which kernels are kept, and why it is not the one that was wanted."""

    path: Path | None
    """None where nothing can be kept: kernels are built in a folder that goes away at once."""
    refused: Refusal | None


def cache_folder() -> Path:
    """The folder in which kernels are wanted: MSNN_CACHE, else the user's cache folder."""
    given = os.environ.get("MSNN_CACHE")
    return Path(given) if given else _folder_of_the_user()


def kernel_folder() -> KernelFolder:
    """The folder that keeps the kernels which are built now."""
    first: Refusal | None = None
    for folder in candidates():
        refused = _refusal(folder)
        if refused is None:
            return KernelFolder(folder, first)
        # people are told of the folder that they wanted, not of the last one that was tried
        first = first or refused
    return KernelFolder(None, first)


def candidates() -> Iterator[Path]:
    """Folders to keep kernels in, the best first."""
    yield from dict.fromkeys((cache_folder(), _folder_of_the_user(), _temporary_folder()))


def opened(folder: Path) -> tuple[Path, str | None]:
    """The folder without symbolic links, made where it is missing, and why it is not trusted.

    What is made is closed to others. Raises OSError.
    """
    real = Path(os.path.realpath(folder))
    missing = [place for place in (real, *real.parents) if not place.exists()]
    if missing:
        # asked before anything is made: a folder made inside somebody else's could be swapped at
        # once
        reason = why_folder_is_not_trusted(missing[-1].parent, is_above=True)
        if reason is not None:
            return real, reason
    for place in reversed(missing):
        with suppress(FileExistsError):
            # one by one: `parents=True` would give the folders above the mode of the umask
            place.mkdir(mode=0o700)
    return real, why_folder_is_not_trusted(real)


@cache
def _had_room(folder: Path) -> None:
    """As `has_room`, asked once a process of a folder that has some: a MB is written for it."""
    has_room(folder)


def _folder_of_the_user() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111
    if base.startswith("~"):  # a user without a home, as in some containers
        return _temporary_folder()
    return Path(base) / "msnn" / "kernels"


def _temporary_folder() -> Path:
    # Windows has a temporary folder for each user
    name = "msnn-kernels" if sys.platform == "win32" else f"msnn-kernels-{os.geteuid()}"
    return Path(tempfile.gettempdir()) / name


def _refusal(folder: Path) -> Refusal | None:
    try:
        real, reason = opened(folder)
        if reason is not None:
            return Refusal(folder, reason, is_foreign=True)
        _had_room(real)
    except OSError as error:
        return Refusal(folder, _words(error), is_foreign=False)
    return None


def _words(error: OSError) -> str:
    return (error.strerror or errno.errorcode.get(error.errno or 0, "it cannot be used")).lower()
