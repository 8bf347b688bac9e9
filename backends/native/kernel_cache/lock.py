"""Lets one process at a time build a file; a process that dies gives its lock back."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from backends.files.waiting import wait_until

_WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)


@contextmanager
def locked(path: Path, limit: float) -> Generator[None]:
    """Holds the lock file `path`, which is gone afterwards; waits `limit` seconds at most.

    After the limit, or on a file system without locks, the block runs all the
    same: what is built is renamed into its place whole, so that two builders only do the work
    twice. So it does on Windows. Raises OSError where no file can be made.
    """
    if sys.platform == "win32":
        yield
        return
    descriptors: list[int] = []

    def taken() -> bool:
        # opened anew at each try: the file that the last try opened may have been removed by its
        # holder
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
                # removed while it is held, so that nobody locks the name of a file that is about to
                # go
                path.unlink()
            os.close(descriptor)


def _is_ours(path: Path, descriptor: int) -> bool:
    import fcntl  # of POSIX alone

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # the holder before may have removed the file: a lock on what is gone keeps nobody out
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except (BlockingIOError, FileNotFoundError):
        return False
    except OSError as error:
        if error.errno not in _WITHOUT_LOCKS:
            raise
        return True
