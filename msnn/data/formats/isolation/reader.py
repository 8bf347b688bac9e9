"""Starts a process that reads files, and reports the reason if that process crashes."""

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
from threading import Event, Lock, Timer
from typing import Any, cast

from msnn.data.formats.isolation.message import ReadRequest, read_message, write_message
from msnn.data.formats.isolation.process import Reader
from msnn.data.formats.plugin_file import PluginReader
from msnn.data.formats.table import ColumnTable, Streams, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.errors.data.files import unreadable_file
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.errors.plugins import TRACEBACKS

_MEMORY = 500_000_000
_TIMES_SIZE = 64
"""Memory limit of a file: a constant plus a multiple of its size; real logs compress at most
20:1.
"""
_SECONDS = 5
_PER_SECOND = 1_000_000
"""Processor time limit of a file: a constant, plus one second per this many bytes."""
_TIMES_SECONDS = 20
"""Limit of the elapsed time, in limits of processor time: a reader may wait without using any."""

_PIPE = 1 << 20
"""Buffer size of a pipe in bytes: the maximum that Linux allows an ordinary process."""

_HOME = Path(__file__).parents[4]
"""The folder that contains the package `msnn`."""
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from msnn.data.formats.isolation.process import serve; serve()"
)


def isolated(of: str | PluginReader) -> Reader:
    """The function `read` of a module, or the reader of a plug-in, run in a separate process.

    A file that crashes the process is reported as unreadable (E0802). All files of a command share
    one process, because readers take long to import.
    """

    def read(
        path: Path, shown: str, wanted: WantedColumns, dialect: Dialect
    ) -> ColumnTable | Streams:
        # for whoever watches this process, as it does not open the file itself
        sys.audit("open", path, "rb", os.O_RDONLY)
        size = path.stat().st_size if path.is_file() else 0
        request = ReadRequest(
            of=of,
            path=path.absolute(),
            shown=shown,
            wanted=wanted,
            dialect=dialect,
            memory=_MEMORY + _TIMES_SIZE * size,
            seconds=_SECONDS + size // _PER_SECOND,
        )
        found: object = _readers(os.getpid()).answer(request)
        if isinstance(found, tuple):
            told = cast("tuple[object, ...]", found)
            TRACEBACKS.extend(each for each in told if isinstance(each, str))
            raise SpecError(each for each in told if isinstance(each, Diagnostic))
        return cast("ColumnTable | Streams", found)

    return read


class _Readers:
    """The reader process: started on first use, and restarted after a crash."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = Lock()
        atexit.register(self.end)

    def answer(self, request: ReadRequest) -> Any:
        with self._lock:
            process = self._process = self._process or _started()
            assert process.stdin is not None
            assert process.stdout is not None
            waited, longest = Event(), _TIMES_SECONDS * request.seconds

            def give_up() -> None:
                waited.set()
                process.kill()

            limit = Timer(longest, give_up)
            limit.daemon = True
            limit.start()
            try:
                write_message(process.stdin, request)
                return read_message(process.stdout)
            except (EOFError, OSError):
                code = self._ended(process)
                reason = _reason(code, request)
                if waited.is_set():
                    reason = f"reading it takes more than {longest} s"
                repair = "open it with the program that wrote it, and write it again from there"
                fault = unreadable_file(request.shown, reason, repair)
                if isinstance(of := request.of, PluginReader):
                    fault = of.fault(request.shown, f"ended its process: {reason}")
                raise SpecError((fault,)) from None
            # a half-read answer would be taken for the next one
            except BaseException:
                self._ended(process)
                raise
            finally:
                limit.cancel()

    def _ended(self, process: subprocess.Popen[bytes]) -> int:
        self._process = None
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        with suppress(subprocess.TimeoutExpired):
            # the system may write down the memory of one that crashed
            return process.wait(timeout=5)
        process.kill()
        return process.wait()

    def end(self) -> None:
        """Stops the process if it is running."""
        if self._process is not None:
            self._ended(self._process)


def end_readers() -> None:
    """Ends the reader process, so that the next file is read by a new one with today's plug-ins."""
    _readers(os.getpid()).end()


@cache
def _readers(process: int) -> _Readers:
    """One instance per process: a forked child must not use its parent's reader."""
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
