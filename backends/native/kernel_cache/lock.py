"""A lock file, so that one process at a time builds a kernel; the lock ends with the process."""

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
    """Holds the lock file `path` and removes it afterwards; waits at most `limit` seconds.

    After the limit, on Windows, or on a file system without locks, the block runs anyway. The
    result is renamed into place atomically, so that two builders only duplicate work. Raises
    OSError if no file can be created.
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
