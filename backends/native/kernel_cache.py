"""Stores compiled kernels in a folder that only this user can write to, one process at a time."""

from __future__ import annotations

import ctypes
import errno
import hashlib
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from backends.files.atomic_write import replacing, sync
from backends.files.c_compiler import compiler_limit, has_room
from backends.files.waiting import wait_until


def why_folder_is_not_trusted(folder: Path, *, is_above: bool = False) -> str | None:
    """A text with the reason why others could change files in a folder; None if only this user and
    root can.

    `folder` exists and has no symbolic link in it (`os.path.realpath`). It and its parents must
    belong to the user or root and be closed to others. Parents with the sticky bit (`/tmp`) are
    allowed, since nobody can replace files of other users there; with `is_above` also the folder
    itself. Raises NotADirectoryError and other OSErrors. Windows protects the user's profile by
    access lists, which are not checked here: None.
    """
    if sys.platform == "win32":
        return None
    for place in (folder, *folder.parents):
        # `lstat`: a link created after `realpath` is not followed
        found = place.lstat()
        if not stat.S_ISDIR(found.st_mode):
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(place))
        stranger = _stranger(found)
        if stranger is not None:
            return f"{place} belongs to {stranger}"
        sticky = bool(found.st_mode & stat.S_ISVTX) and (is_above or place != folder)
        if not sticky and _others_may_write(found):
            return f"others may write to {place}"
    return None


def is_trusted_file(descriptor: int) -> bool:
    """True if an open file, given by its descriptor, is a regular file that only this user or root
    can write.
    """
    # the open file, since its path may be another file by now
    found = os.fstat(descriptor)
    if sys.platform == "win32":
        return stat.S_ISREG(found.st_mode)
    return stat.S_ISREG(found.st_mode) and _stranger(found) is None and not _others_may_write(found)


def _stranger(found: os.stat_result) -> str | None:
    """The name of the owner of a file (or `the user <id>`), if it is neither this user nor root;
    otherwise None.
    """
    if found.st_uid in (os.geteuid(), 0):
        return None
    import pwd  # of POSIX alone

    try:
        return pwd.getpwuid(found.st_uid).pw_name
    except KeyError:
        return f"the user {found.st_uid}"


def _others_may_write(found: os.stat_result) -> bool:
    if found.st_mode & stat.S_IWOTH:
        return True
    return bool(found.st_mode & stat.S_IWGRP) and not _is_group_of_the_user_alone(found.st_gid)


def _is_group_of_the_user_alone(group: int) -> bool:
    """True if the group with this id has the user's name and no other member, as on systems that
    create a private group for each user.
    """
    import grp
    import pwd

    try:
        user, members = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return (
        user.pw_gid == group
        and members.gr_name == user.pw_name
        and set(members.gr_mem) <= {user.pw_name}
    )


@dataclass(frozen=True, slots=True)
class Refusal:
    """A folder that cannot store kernels, and the reason as text."""

    folder: Path
    reason: str
    is_foreign: bool
    """True if others could have written kernels to it; otherwise it is full or not writable."""


@dataclass(frozen=True, slots=True)
class KernelFolder:
    """The folder that stores kernels. If it is not the requested one, `refused` has the reason,
    otherwise None.
    """

    path: Path | None
    """None if no folder works; kernels are then built in a temporary folder."""
    refused: Refusal | None


def cache_folder() -> Path:
    """The folder that the user requests for kernels: environment variable MSNN_CACHE, otherwise the
    usual cache folder. It need not exist.
    """
    given = os.environ.get("MSNN_CACHE")
    return Path(given) if given else _folder_of_the_user()


def kernel_folder() -> KernelFolder:
    """The first of the candidates that is trusted and has room, and the reason why the requested
    one was refused. Creates missing folders.
    """
    first: Refusal | None = None
    for folder in candidates():
        refused = _refusal(folder)
        if refused is None:
            return KernelFolder(folder, first)
        # users need the reason for the requested folder, not for the last candidate
        first = first or refused
    return KernelFolder(None, first)


def candidates() -> Iterator[Path]:
    """Folders for kernels, best first: the requested one, the user's cache folder, a temporary
    one.
    """
    yield from dict.fromkeys((cache_folder(), _folder_of_the_user(), _temporary_folder()))


def opened(folder: Path) -> tuple[Path, str | None]:
    """The path of the folder without symbolic links, and the reason why it is not trusted, None if
    it is. A missing folder is created, private to the user. Raises OSError.
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
    """Raises OSError if the folder does not take a file of 1 MB. A success is remembered for this
    process.
    """
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


_A_DAY = 86_400.0
_UNDER_WAY = 3600.0
"""Seconds after which a file without a kernel is considered left by a killed process."""

_OF_KERNELS = re.compile(r"\.?(?:build-)?([0-9a-f]{32})[.-].*")
"""Names of cache files and folders; all others are ignored, wherever MSNN_CACHE points."""


@dataclass(frozen=True, slots=True)
class KeptKernel:
    """A kernel in the cache: its files, their total size in bytes, and the time of its latest use
    in seconds since 1970.
    """

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
    """The kernels stored in a folder, most recently used first. Other files are ignored."""
    # MSNN_CACHE may be a folder with other libraries, which are neither counted nor removed
    keys = {path.stem for path in folder.glob("*.so") if _OF_KERNELS.fullmatch(path.name)}
    return sorted((_kernel(folder, key) for key in keys), key=lambda kernel: -kernel.used)


def clean(folder: Path, limits: CacheLimits) -> Sequence[KeptKernel]:
    """Removes kernels beyond the limits, and files left by killed processes. Returns the removed
    kernels. A process that has loaded one can still use it. Raises OSError.
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
    """Files and folders that no kernel needs any more: of builds that were interrupted over an hour
    before `now` (seconds), and notes of removed kernels.
    """
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


_WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)


@contextmanager
def locked(path: Path, limit: float) -> Generator[None]:
    """Holds a lock on the file `path` while the block runs, and removes the file afterwards. Waits
    at most `limit` seconds; after that, on Windows, or on a file system without locks, the block
    runs anyway. That is safe, as the result is renamed into place atomically: two builders only
    duplicate work. Raises OSError if the file cannot be created.
    """
    if sys.platform == "win32":
        yield
        return
    descriptors: list[int] = []

    def taken() -> bool:
        # opened again at each try: the holder may have removed the previous file
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        if not _is_ours(path, descriptor):
            os.close(descriptor)
            return False
        descriptors.append(descriptor)
        return True

    wait_until(taken, limit)
    try:
        yield
    finally:
        for descriptor in descriptors:
            with suppress(FileNotFoundError):
                # removed while locked, so that nobody locks a file that is about to be removed
                path.unlink()
            os.close(descriptor)


def _is_ours(path: Path, descriptor: int) -> bool:
    import fcntl  # POSIX only

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # the previous holder may have removed the file; a lock on a removed file has no effect
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except (BlockingIOError, FileNotFoundError):
        return False
    except OSError as error:
        if error.errno not in _WITHOUT_LOCKS:
            raise
        return True


if sys.platform == "win32":
    _ALONE = os.O_BINARY | os.O_NOINHERIT
else:
    # a link could leave the trusted folder, and a pipe would wait for a writer
    _ALONE = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


@dataclass(frozen=True, slots=True)
class StoredKernel:
    """The files of one kernel in a trusted folder. `key` is the hash of source, flags, compiler and
    processor. The files need not exist.
    """

    folder: Path
    key: str

    @property
    def library(self) -> Path:
        """The path of the shared library."""
        return self.folder / f"{self.key}.so"

    @property
    def digest(self) -> Path:
        """The path of the file with the SHA-256 of the library's bytes, which is written after the
        library.
        """
        return self.folder / f"{self.key}.sha256"

    @property
    def seal(self) -> Path:
        """The path of the file with the SHA-256 of a library that agreed with the reference
        interpreter.
        """
        return self.folder / f"{self.key}.checked"

    def whole(self) -> str | None:
        """The SHA-256 of the library if it equals the stored one; otherwise None. Loading a
        truncated or modified library could crash the process. Files that others can write count as
        missing.
        """
        noted, bytes_ = _read(self.digest), _read(self.library)
        if noted is None or bytes_ is None:
            return None
        found = hashlib.sha256(bytes_).hexdigest()
        return found if noted == found.encode() else None

    def load(self) -> ctypes.CDLL:
        """Loads the library into this process and notes its use. Raises OSError if the system
        refuses it.
        """
        with suppress(OSError):  # a read-only folder
            if time.time() - self.digest.stat().st_mtime > _A_DAY:
                os.utime(self.digest)  # time of latest use, for `clean`
        return ctypes.CDLL(str(self.library))

    def built(self, build: Callable[[Path, Path], None]) -> str:
        """Builds the library unless another process did meanwhile; returns its SHA-256.
        `build(library, folder)` writes the file `library` and may use the folder for others. Raises
        the exceptions of `build`, and OSError if the folder accepts no files.
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
        """True if a library with this SHA-256 agreed with the reference interpreter."""
        return _read(self.seal) == digest.encode()

    def mark_checked(self, digest: str) -> None:
        """Notes that the library with this SHA-256 agreed with the reference interpreter; does
        nothing if the folder is not writable.
        """
        with suppress(OSError):
            _write(self.seal, digest.encode())


def _read(path: Path) -> bytes | None:
    """The bytes of a regular file that only this user or root can write; None for other, missing or
    unreadable files.
    """
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
    """Writes bytes to a file so that it has either its old or its new content, also after a power
    failure. Raises OSError.
    """
    with replacing(path, takes_streams=False) as temporary:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | _ALONE, 0o600)
        with open(descriptor, "wb") as file:  # noqa: PTH123  (there is a descriptor, not a path)
            file.write(data)
            file.flush()
            os.fsync(descriptor)
    sync(path.parent)
