"""Creates processes with preloaded slow modules, if the platform supports it."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from multiprocessing import forkserver
from multiprocessing.context import BaseContext

from msnn.project.imports import away_from_folder

_SAFE_PATH = "PYTHONSAFEPATH"


def process_context(modules: Sequence[str]) -> BaseContext:
    """The multiprocessing context for new processes, with `modules` imported in advance if
    possible.

    Processes are forked from a server that only imports modules, or spawned. Processes forked from
    this one would inherit locks of numpy's and torch's threads. The server starts once per process,
    with the modules and environment of that time; other modules are imported on demand.
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
    """A context in which new Python processes import no modules from the working folder.

    Otherwise they would, like `python -c`: a user's `statistics.py` would replace Python's.
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
