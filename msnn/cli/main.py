"""The entry point `msnn`: ends the process with the exit code of the command.

Loading the commands takes a while. This module imports almost nothing, so that Ctrl-C is handled
early.
"""

from __future__ import annotations

import gc
import os
import sys
from io import TextIOWrapper
from typing import NoReturn

from msnn.cli.interrupts import (
    INTERRUPTED,
    interrupt_on_signals,
    is_interrupt,
    was_interrupted,
)
from msnn.project.imports import load_away_from_folder, load_metadata_when_asked

_LOOKING = frozenset({"check", "compile", "diff", "show"})
"""Commands that use numpy for little more than the constants of a spec."""


def main() -> NoReturn:
    """Runs the command line of this process, and ends it with the command's exit code."""
    # Loading makes many objects and hardly any garbage: looking for it took a tenth of `check`.
    gc.set_threshold(100_000, 20, 20)
    # numpy would start a thread for each core, which take their time to wait: see decision 0380
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    load_away_from_folder()
    looks = not _LOOKING.isdisjoint(sys.argv[1:2])
    if looks:
        # what a spec of a megabyte leaves is small: the end of the process is soon enough
        gc.disable()
        # pydantic would look for plugins in every distribution of the environment
        os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
        load_metadata_when_asked()
    try:
        # before the import below, which takes most of the time of a short command
        interrupt_on_signals()
        _open_closed_streams()
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, TextIOWrapper):
                # a terminal without UTF-8 shows `?` for a Greek letter instead of failing
                stream.reconfigure(errors="replace")
        from msnn.cli.application import run

        code = int(run(sys.argv[1:]))
        if was_interrupted() and code != INTERRUPTED:
            # whatever caught the error went on: a result that nobody waited for is no success
            print("interrupted", file=sys.stderr)
            code = INTERRUPTED
    # KeyboardInterrupt is no Exception, and an import may wrap it in an ImportError
    except BaseException as error:
        if not is_interrupt(error):
            raise
        print("interrupted", file=sys.stderr)
        code = INTERRUPTED
    if looks:
        _leave(code)
    sys.exit(code)


def _open_closed_streams() -> None:
    """Replaces closed standard streams (`>&-`) by the null device: input is empty, output is
    discarded.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            # takes the closed one's number, which would be that of the next file that is opened
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))


def _leave(code: int) -> None:
    """Ends the process without freeing its objects, which would take a twentieth of the time of
    `check`. Returns if output cannot be written, so that Python reports it.
    """
    try:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, TextIOWrapper):
                stream.flush()
    except (OSError, ValueError):
        return  # as it ends otherwise, Python tells what could not be written
    os._exit(code)
