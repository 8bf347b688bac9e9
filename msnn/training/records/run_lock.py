"""Keeps two processes from training one run at the same time."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
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
