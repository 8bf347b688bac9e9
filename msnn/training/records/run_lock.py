"""Prevents two processes from training one run at the same time: one is refused, or waits."""

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
    """Locks the folder of a run; SpecError if another process holds the lock.

    The system releases the lock when the process ends. There is no lock on Windows, where folders
    cannot be opened, and on file systems without locks.
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
    """Waits until no other process trains the run of this folder, which need not exist yet.

    Other commands that use `alone` wait too. There is no lock on Windows.
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
    """True if the open file is still the file at that path; another process may have removed it."""
    try:
        return os.path.samestat(os.fstat(number), lock.stat())
    except FileNotFoundError:
        return False
