"""The process that reads files for another process, with limits of memory and processor time."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import IO, TypeAlias

from msnn.data.formats.isolation.message import ReadRequest, read_message, write_message
from msnn.data.formats.table import ColumnTable, Streams, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.errors.data.files import reason_of, unreadable_file
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.errors.plugins import TRACEBACKS

Reader: TypeAlias = Callable[[Path, str, WantedColumns, Dialect], ColumnTable | Streams]
"""(path, its name in messages, requested columns, text layout) → columns; raises SpecError."""


def serve() -> None:
    """Answers requests from the standard input until it is closed."""
    # the user's Ctrl-C ends the one who asks, and that ends this one
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "wb")
    # libraries print messages about a file to the standard output
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    while (request := _next(sys.stdin.buffer)) is not None:
        write_message(answers, _answer(request))


def _next(requests: IO[bytes]) -> ReadRequest | None:
    with suppress(EOFError):
        return read_message(requests)
    return None


def _answer(request: ReadRequest) -> object:
    # the limits of the file before: libraries need more than a small file may take
    _limit(None, None)
    read = import_module(request.of).read if isinstance(request.of, str) else request.of
    TRACEBACKS.clear()
    # after the import: what the reader itself takes is no fault of the file
    _limit(request.memory, request.seconds)
    try:
        return _read(read, request)
    except SpecError as error:
        return (*error.diagnostics, *TRACEBACKS)


def _read(read: Reader, request: ReadRequest) -> ColumnTable | Streams:
    try:
        return read(request.path, request.shown, request.wanted, request.dialect)
    except SpecError:
        raise
    except MemoryError as error:
        # no repair: the file may be whole
        reason = f"reading it takes more than {request.memory // 1_000_000} MB of memory"
        raise SpecError((unreadable_file(request.shown, reason),)) from error
    except Exception as error:
        reason = reason_of(error, request.path)
        raise SpecError((unreadable_file(request.shown, reason),)) from error


def _limit(memory: int | None, seconds: int | None) -> None:
    """Limits what the process takes from now on; None is no limit."""
    try:
        import resource
    # Windows
    except ImportError:
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    time = int(used.ru_utime + used.ru_stime) + 1
    limits = {
        resource.RLIMIT_AS: None if memory is None else _address_space() + memory,
        resource.RLIMIT_CPU: None if seconds is None else time + seconds,
    }
    for kind, limit in limits.items():
        hard = resource.getrlimit(kind)[1]
        soft = hard
        if limit is not None:
            soft = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        # macOS knows RLIMIT_AS and refuses it
        with suppress(ValueError, OSError):
            resource.setrlimit(kind, (soft, hard))


def _address_space() -> int:
    """Bytes of memory that the process already addresses; 4 GiB if the system does not report
    it.
    """
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except OSError:
        return 4 << 30
    return pages * os.sysconf("SC_PAGE_SIZE")
