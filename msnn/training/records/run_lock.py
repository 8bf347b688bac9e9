"""Keeps two processes from training one run at the same time: one is refused, or waits."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from msnn.errors.learning.run_ends import still_runs
from spec_schema.diagnostics.diagnostic import SpecError


@contextmanager
def held(run: Path | None) -> Generator[None]:
    """Holds the folder of a run; SpecError where another process does.

    The system forgets the lock with the process, however that ends. Windows, where folders cannot
    be opened, and file systems without locks have none.
    """
    if run is None or sys.platform == "win32":
        yield
        return
    import fcntl  # of POSIX alone

    # the folder itself: a lock file would stay behind where the process is killed
    number = os.open(run, os.O_RDONLY)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SpecError((still_runs(str(run)),)) from None
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(number)


@contextmanager
def alone(run: Path) -> Generator[None]:
    """Waits until no other process trains the run of this folder, which need not be there yet.

    It holds for commands that wait so too. As above, Windows has no lock.
    """
    if sys.platform == "win32":
        yield
        return
    lock = run.with_name(f".{run.name}.lock")
    lock.parent.mkdir(parents=True, exist_ok=True)
    number = _locked(lock)
    try:
        yield
    finally:
        # while it is held: who waits for it sees that the file is gone, and makes another
        lock.unlink(missing_ok=True)
        os.close(number)


def _locked(lock: Path) -> int:
    import fcntl

    while True:
        number = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(number, fcntl.LOCK_EX)
            if _is_there(lock, number):
                return number
        except BaseException:  # an interrupt while it waits
            os.close(number)
            raise
        os.close(number)


def _is_there(lock: Path, number: int) -> bool:
    """Whether the open file is the one of that name, which another process may have removed."""
    try:
        return os.path.samestat(os.fstat(number), lock.stat())
    except FileNotFoundError:
        return False
