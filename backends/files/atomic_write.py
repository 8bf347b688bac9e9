"""Writes files atomically under a temporary name; appends records completely or not at all."""

from __future__ import annotations

import errno
import os
import re
import shutil
import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from io import SEEK_END, FileIO
from pathlib import Path
from stat import S_IRUSR, S_ISLNK, S_ISREG
from tempfile import TemporaryDirectory
from types import FrameType
from typing import BinaryIO

_OPENED = re.compile(r"/dev/(?:stdout|stderr)|(?:/dev|/proc/self)/fd/(?P<number>\d+)")
"""Names of streams that the shell opened for a command."""


def write_text(path: Path, text: str, *, durable: bool = False) -> Path:
    """Writes text as UTF-8, with line ends as they are in it; returns the path. Missing folders are
    created. A `durable` file is on the disk before this returns. An OSError leaves the previous
    file.
    """
    return write_bytes(path, text.encode("utf-8"), durable=durable)


def write_bytes(
    path: Path, data: bytes, *, durable: bool = False, named_later: bool = False
) -> Path:
    """Writes the bytes; returns the path. Missing folders are created. An OSError leaves the
    previous file.

    A `durable` file is on the disk, with its name, before this returns: after a power cut either it
    or the previous file exists. This takes some milliseconds. With `named_later` it waits for the
    content only: for some seconds a power cut may still leave the previous file, but never a torn
    one.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(data)
        if durable:
            sync(temporary)
    if durable and not named_later:
        with naming(path):
            # syncs the rename, which is stored in the folder
            sync(path.parent)
    return path


@contextmanager
def replacing(path: Path, *, takes_streams: bool = True) -> Generator[Path]:
    """Context manager that gives a temporary path, for a writer that opens files itself. On success
    the file is renamed to `path`; on an exception `path` stays as it was.

    Missing folders are created. The name contains the process id, so that two writers of one file
    do not mix; the last one wins. A device, a pipe or a shell stream receives the bytes of the
    finished file if `takes_streams`; otherwise it is replaced. Raises OSError, such as
    IsADirectoryError.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if takes_streams and _is_stream(path):
        with TemporaryDirectory(prefix="msnn-stream-") as place:
            temporary = Path(place) / path.name
            with naming(path, temporary):
                yield temporary
                with _stream(path) as stream:
                    stream.write(temporary.read_bytes())
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = part_of(path)
    try:
        with naming(path, temporary):
            yield temporary
            _require_readable(temporary)
            temporary.replace(path)
    finally:
        with suppress(OSError):  # what cannot be made cannot be removed; the first error counts
            temporary.unlink(missing_ok=True)


def _is_stream(path: Path) -> bool:
    """True if the path is a pipe, a device or a stream that the shell opened; False for a regular
    or missing file.
    """
    if _OPENED.fullmatch(str(path)) is not None:
        return True
    try:
        # lstat: links are not followed, as another user may have created them
        mode = path.lstat().st_mode
    except OSError:
        return False
    # a rename would replace `/dev/null`, system-wide if root does it
    return not S_ISREG(mode) and not S_ISLNK(mode)


def _stream(path: Path) -> BinaryIO:
    opened = _OPENED.fullmatch(str(path))
    if opened is None:
        return path.open("wb")
    # a duplicate of the descriptor: opening the path again would start at offset 0
    number = opened["number"] or (1 if path.name == "stdout" else 2)
    return os.fdopen(os.dup(int(number)), "wb")


def _require_readable(path: Path) -> None:
    """Raises OSError if the file or folder exists and its owner may not read it, as an unusual
    umask causes.
    """
    if path.exists() and not path.stat().st_mode & S_IRUSR:
        reason = "the umask would leave a file that its owner cannot read: set another, as 022"
        raise OSError(errno.EACCES, reason, str(path))


@contextmanager
def replacing_files(folder: Path) -> Generator[Path]:
    """Context manager that gives a temporary folder for several files, which then appear in
    `folder` together. A new folder appears in one step. In an existing folder each file is renamed
    after all are complete; its other files stay. If the block raises, nothing changes. Raises
    OSError.
    """
    folder = Path(os.path.realpath(folder))
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = part_of(folder)
    try:
        with naming(folder, temporary):
            shutil.rmtree(temporary, ignore_errors=True)
            temporary.mkdir()
            yield temporary
            _appear(temporary, folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def naming(path: Path, temporary: Path | None = None) -> Generator[None]:
    """Context manager that puts the name of the user's file, `path`, into an OSError of its block
    that has no file name or that of `temporary`.
    """
    try:
        yield
    except OSError as error:
        # a failed write, unlike a failed open, has no file name
        if error.errno is not None and error.filename is None:
            error.filename = str(path)
        elif temporary is not None and isinstance(error.filename, str | os.PathLike):
            shown = os.fspath(error.filename)
            if shown == str(temporary) or shown.startswith(f"{temporary}{os.sep}"):
                error.filename = f"{path}{shown.removeprefix(str(temporary))}"
        raise


def part_of(path: Path) -> Path:
    """The path next to `path` at which this process writes the file before it is renamed."""
    return path.with_name(f".{path.name}.{os.getpid()}.part")


def sync(path: Path) -> None:
    """Waits until the content of a file, or the names in a folder, are on the disk. Raises OSError.
    Does nothing for folders on Windows.
    """
    if path.is_dir() and os.name != "posix":
        return  # only there a folder can be opened
    number = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def _appear(temporary: Path, folder: Path) -> None:
    """Moves finished files from a temporary folder to `folder`. Raises OSError before the first
    move if a file is not readable or a folder is in its place.
    """
    _require_readable(temporary)
    files = sorted(path for path in temporary.rglob("*") if not path.is_dir())
    for path in files:
        _require_readable(path)
        sync(path)
    if not folder.exists():
        try:
            # one rename for a new folder; an existing folder cannot be replaced
            temporary.replace(folder)
        except OSError:
            if not folder.is_dir():  # another process has created it meanwhile
                raise
        else:
            return
    for path in files:
        place = folder / path.relative_to(temporary)
        place.parent.mkdir(parents=True, exist_ok=True)
        # checked before the first rename, so that a failure changes no file
        if place.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(place))
    # between the first and the last rename, old and new files are mixed
    with signals_wait():
        for path in files:
            path.replace(folder / path.relative_to(temporary))


@contextmanager
def signals_wait() -> Generator[None]:
    """Context manager: SIGINT and SIGTERM that come during the block are handled after it. It has
    no effect outside the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        del frame
        came.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        # after restoring all handlers, as the first signal may raise an exception
        for number in came:
            signal.raise_signal(number)


@dataclass(slots=True)
class AppendedFile:
    """A file to which records are appended, each written at once. It is created by the first
    record.
    """

    path: Path
    _file: FileIO | None = field(init=False, default=None)

    def write(self, record: bytes) -> None:
        """Appends the record completely, or raises an OSError that names the file and leaves it
        unchanged.
        """
        with naming(self.path):
            if self._file is None:
                # unbuffered: otherwise `close` would retry data that a full disk refused
                self._file = self.path.open("ab", buffering=0)
            end = self._file.seek(0, SEEK_END)
            rest = record
            try:
                while rest:
                    rest = rest[self._file.write(rest) :]
            except OSError:
                # remove the first bytes of a partly written record
                with suppress(OSError):
                    self._file.truncate(end)
                raise

    def close(self) -> None:
        """Closes the file; a later record opens it again."""
        if self._file is not None:
            self._file.close()
            self._file = None
