"""Has files read by a process of its own, and says why where that process ended."""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any

from msnn.data.formats.isolation.message import ReadRequest, read_message, write_message
from msnn.data.formats.isolation.process import Reader
from msnn.data.formats.table import ColumnTable, Streams, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.errors.data.files import unreadable_file
from spec_schema.diagnostics.diagnostic import SpecError

_MEMORY = 1 << 30
_TIMES_SIZE = 64
"""Memory for a file: so much, and so many times its size; real logs are packed by 20 at most."""
_SECONDS = 20
_PER_SECOND = 1_000_000
"""Processor time for a file: so many seconds, and one for so many bytes more."""

_PIPE = 1 << 20
"""Bytes of a pipe: the most that Linux gives to any process."""

_HOME = Path(__file__).parents[4]
"""The folder in which the package `msnn` lies."""
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from msnn.data.formats.isolation.process import serve; serve()"
)


def isolated(module: str) -> Reader:
    """The reader `read` of a module, run in a process of its own.

    A file that ends that process is an unreadable file (E0802). One process serves all files of a
    command, since readers take long to load.
    """

    def read(
        path: Path, shown: str, wanted: WantedColumns, dialect: Dialect
    ) -> ColumnTable | Streams:
        # for whoever watches this process, as it does not open the file itself
        sys.audit("open", path, "rb", os.O_RDONLY)
        size = path.stat().st_size if path.is_file() else 0
        request = ReadRequest(
            module=module,
            path=path.absolute(),
            shown=shown,
            wanted=wanted,
            dialect=dialect,
            memory=_MEMORY + _TIMES_SIZE * size,
            seconds=_SECONDS + size // _PER_SECOND,
        )
        found = _readers(os.getpid()).answer(request)
        if isinstance(found, tuple):
            raise SpecError(found)
        return found

    return read


class _Readers:
    """The process that reads, started when a file needs it and again after one that ended it."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = Lock()
        atexit.register(self.end)

    def answer(self, request: ReadRequest) -> Any:
        with self._lock:
            process = self._process = self._process or _started()
            assert process.stdin is not None
            assert process.stdout is not None
            try:
                write_message(process.stdin, request)
                return read_message(process.stdout)
            except (EOFError, OSError):
                code = self._ended(process)
                reason = _reason(code, request)
                repair = "open it with the program that wrote it, and write it again from there"
                raise SpecError((unreadable_file(request.shown, reason, repair),)) from None
            # a half-read answer would be taken for the next one
            except BaseException:
                self._ended(process)
                raise

    def _ended(self, process: subprocess.Popen[bytes]) -> int:
        self._process = None
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        with suppress(subprocess.TimeoutExpired):
            return process.wait(timeout=1)
        process.kill()
        return process.wait()

    def end(self) -> None:
        """Ends the process, if there is one."""
        if self._process is not None:
            self._ended(self._process)


@cache
def _readers(process: int) -> _Readers:
    """One for each process: a copy of it that the system makes has none of its own."""
    del process
    return _Readers()


def _started() -> subprocess.Popen[bytes]:
    # isolated, with the paths of this process but the working folder: a `numpy.py` that lies beside
    # the spec is none of ours
    here = Path.cwd()
    paths = [path for path in sys.path if Path(path).is_absolute() and Path(path) != here]
    known = json.dumps([*paths, str(_HOME)])
    return subprocess.Popen(
        (sys.executable, "-I", "-c", _START, known),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        pipesize=_PIPE,
        cwd=here.anchor,
        # it multiplies no matrices: threads that wait would only take time to start
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )


def _reason(code: int, request: ReadRequest) -> str:
    if code == -getattr(signal, "SIGXCPU", 0):
        return f"reading it takes more than {request.seconds} s of the processor"
    if code < 0:
        name = signal.Signals(-code).name
        return f"it is damaged: it ended its reader ({name})"
    return f"it is damaged: it ended its reader (exit code {code})"
