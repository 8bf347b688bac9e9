"""Chooses the folder for kernels: the configured one, otherwise one of the user."""

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
    """A requested folder that cannot be used, and the reason."""

    folder: Path
    reason: str
    is_foreign: bool
    """True if others could have written kernels to it; otherwise it is full or not writable."""


@dataclass(frozen=True, slots=True)
class KernelFolder:
    """The folder for kernels, and the reason why it is not the requested one."""

    path: Path | None
    """None if no folder works; kernels are then built in a temporary folder."""
    refused: Refusal | None


def cache_folder() -> Path:
    """The requested folder: MSNN_CACHE, otherwise the user's cache folder."""
    given = os.environ.get("MSNN_CACHE")
    return Path(given) if given else _folder_of_the_user()


def kernel_folder() -> KernelFolder:
    """The folder that stores new kernels."""
    first: Refusal | None = None
    for folder in candidates():
        refused = _refusal(folder)
        if refused is None:
            return KernelFolder(folder, first)
        # users need the reason for the requested folder, not for the last candidate
        first = first or refused
    return KernelFolder(None, first)


def candidates() -> Iterator[Path]:
    """Folders for kernels, best first."""
    yield from dict.fromkeys((cache_folder(), _folder_of_the_user(), _temporary_folder()))


def opened(folder: Path) -> tuple[Path, str | None]:
    """The folder without symbolic links, created if missing, and the reason why it is not trusted.

    New folders are private to the user. Raises OSError.
    """
    real = Path(os.path.realpath(folder))
    missing = [place for place in (real, *real.parents) if not place.exists()]
    if missing:
        # checked first: a folder created inside another user's folder could be swapped
        reason = why_folder_is_not_trusted(missing[-1].parent, is_above=True)
        if reason is not None:
            return real, reason
    for place in reversed(missing):
        with suppress(FileExistsError):
            # one by one: `parents=True` would create parents with the mode of the umask
            place.mkdir(mode=0o700)
    return real, why_folder_is_not_trusted(real)


@cache
def _had_room(folder: Path) -> None:
    """Like `has_room`, cached once it succeeds, as it writes 1 MB."""
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
