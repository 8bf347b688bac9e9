"""Stores one kernel in a folder: the library, and the hash of its bytes."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from backends.files.atomic_write import replacing, sync
from backends.files.run_compiler import compiler_limit
from backends.native.kernel_cache.lock import locked
from backends.native.kernel_cache.trust import is_trusted_file

_A_DAY = 86_400.0

if sys.platform == "win32":
    _ALONE = os.O_BINARY | os.O_NOINHERIT
else:
    # a link could leave the trusted folder, and a pipe would wait for a writer
    _ALONE = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


@dataclass(frozen=True, slots=True)
class StoredKernel:
    """A kernel, by its key, in a trusted folder."""

    folder: Path
    key: str

    @property
    def library(self) -> Path:
        """The shared library."""
        return self.folder / f"{self.key}.so"

    @property
    def digest(self) -> Path:
        """The file with the hash of the library's bytes, written after the library."""
        return self.folder / f"{self.key}.sha256"

    @property
    def seal(self) -> Path:
        """The file that marks these bytes as verified."""
        return self.folder / f"{self.key}.checked"

    def whole(self) -> str | None:
        """The hash of the library if it equals the stored hash; otherwise None.

        Loading a truncated or modified library could crash the process. Files that others can write
        do not count.
        """
        noted, bytes_ = _read(self.digest), _read(self.library)
        if noted is None or bytes_ is None:
            return None
        found = hashlib.sha256(bytes_).hexdigest()
        return found if noted == found.encode() else None

    def load(self) -> ctypes.CDLL:
        """Loads the library. Raises OSError if the system refuses it."""
        with suppress(OSError):  # a read-only folder
            if time.time() - self.digest.stat().st_mtime > _A_DAY:
                os.utime(self.digest)  # time of latest use, for `clean`
        return ctypes.CDLL(str(self.library))

    def built(self, build: Callable[[Path, Path], None]) -> str:
        """Builds the library unless another process did meanwhile; returns its hash.

        `build(library, folder)` creates the library and may use the folder. Raises its exceptions,
        and OSError if the folder accepts no files.
        """
        with locked(self.folder / f"{self.key}.lock", 2 * compiler_limit()):
            # checked again under the lock: the previous holder has probably built it
            found = self.whole()
            if found is not None:
                return found
            for left in self.folder.glob(f".build-{self.key}-*"):  # of a process that was killed
                shutil.rmtree(left, ignore_errors=True)
            with tempfile.TemporaryDirectory(
                prefix=f".build-{self.key}-", dir=self.folder, ignore_cleanup_errors=True
            ) as place:
                library = Path(place) / "kernel.so"
                build(library, Path(place))
                bytes_ = library.read_bytes()
            found = hashlib.sha256(bytes_).hexdigest()
            # removed first: a seal is valid only for the bytes that were verified
            self.seal.unlink(missing_ok=True)
            _write(self.library, bytes_)
            _write(self.digest, found.encode())
            return found

    def is_checked(self, digest: str) -> bool:
        """True if the library with this hash was verified."""
        return _read(self.seal) == digest.encode()

    def mark_checked(self, digest: str) -> None:
        """Marks the library with this hash as verified, if the folder is writable."""
        with suppress(OSError):
            _write(self.seal, digest.encode())


def _read(path: Path) -> bytes | None:
    """The bytes of a file that only this user can write, or None."""
    try:
        descriptor = os.open(path, os.O_RDONLY | _ALONE)
    except OSError:
        return None
    with open(descriptor, "rb") as file:  # noqa: PTH123  (there is a descriptor, not a path)
        try:
            return file.read() if is_trusted_file(descriptor) else None
        except OSError:
            return None


def _write(path: Path, data: bytes) -> None:
    """Writes the bytes to disk, renames the file into place, and syncs the folder."""
    with replacing(path, takes_streams=False) as temporary:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | _ALONE, 0o600)
        with open(descriptor, "wb") as file:  # noqa: PTH123  (there is a descriptor, not a path)
            file.write(data)
            file.flush()
            os.fsync(descriptor)
    sync(path.parent)
