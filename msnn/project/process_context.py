"""Opens processes that have slow modules when they begin, where the platform lets them."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from multiprocessing import forkserver
from multiprocessing.context import BaseContext

from msnn.project.away_from_folder import away_from_folder

_SAFE_PATH = "PYTHONSAFEPATH"


def process_context(modules: Sequence[str]) -> BaseContext:
    """Processes forked from a server that has done nothing but import, or started afresh.

    Forked from this one they would share locks of numpy's and torch's threads in the state of the
    moment. The server is started once by a process of Python, and knows the modules of that time;
    others are imported where they are needed. Its environment is that of the time too.
    """
    # Windows
    if "forkserver" not in multiprocessing.get_all_start_methods():
        os.environ[_SAFE_PATH] = "1"  # each process starts afresh, whenever it is needed
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(modules))
    with children_off_working_folder(), away_from_folder():
        forkserver.ensure_running()
    return context


@contextmanager
def children_off_working_folder() -> Generator[None]:
    """Processes of Python that begin meanwhile import nothing from the working folder.

    They would look there first, as `python -c` does: a user's `statistics.py` is not Python's.
    """
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SAFE_PATH]
        else:
            os.environ[_SAFE_PATH] = before
