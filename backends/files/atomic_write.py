"""Writes files whole or not at all: under a temporary name beside the target, then renamed."""

from __future__ import annotations

import errno
import os
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path


def write_text(path: Path, text: str) -> Path:
    """Writes UTF-8 text with `\\n` line ends on every system; returns the path."""
    return write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, data: bytes) -> Path:
    """Writes the bytes; returns the path. OSError leaves what stood there before."""
    with replacing(path) as temporary:
        temporary.write_bytes(data)
    return path


@contextmanager
def replacing(path: Path) -> Generator[Path]:
    """A temporary path for a writer that opens files itself; renamed to `path` if it succeeds.

    Missing folders are made. The name carries the process id, so that two processes that write the
    same file do not mix; the last to finish wins.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        if error.filename in (temporary, str(temporary)):
            error.filename = str(path)  # the name that the user knows
        raise
    finally:
        with suppress(OSError):  # what cannot be made cannot be removed; the first error counts
            temporary.unlink(missing_ok=True)
