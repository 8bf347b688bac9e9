"""Runs a compiler within a limit of time and leaves no process of it behind."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from backends.files.atomic_write import naming
from backends.files.waiting import wait_until

LIMIT = 600.0
"""Seconds, where MSNN_COMPILER_SECONDS names no others: far more than the largest kernels take."""


_ROOM = 1 << 20
"""Bytes that must fit into a folder; most kernels and libraries are smaller."""


class CompilerTooSlowError(Exception):
    """A compiler did not end within its limit, and was ended."""

    remedy = "set CC to another compiler, or MSNN_COMPILER_SECONDS to the seconds that it needs"

    def __init__(self, limit: float) -> None:
        super().__init__(f"did not end within {limit:g} s")


@dataclass(frozen=True, slots=True)
class Finished:
    """A compiler that ended by itself: its exit code and what it wrote."""

    code: int
    output: str
    errors: str


def run_compiler(
    command: Sequence[str],
    source: str = "",
    folder: Path | None = None,
    *,
    longest: float = math.inf,
) -> Finished:
    """Runs the command with `source` as its input; temporary files lie in `folder`.

    It has `compiler_limit()` seconds, `longest` where that is less.

    The compiler has a session of its own: Ctrl-C of a terminal reaches this process alone, which
    may want to finish something. Whatever ends the waiting ends the compiler and all that it
    started. Raises CompilerTooSlowError, KeyboardInterrupt, and OSError where the command cannot be
    started or the folder takes no file.
    """
    limit = min(longest, compiler_limit())
    # files and no pipes: what outlives the compiler keeps nobody waiting
    with tempfile.TemporaryDirectory(prefix="msnn-compiler-", dir=folder) as place:
        given, output, errors = (Path(place) / name for name in ("source", "output", "errors"))
        with naming(given):
            given.write_text(source, encoding="utf-8")
        with given.open("rb") as source_file, output.open("wb") as out, errors.open("wb") as err:
            process = subprocess.Popen(
                command,
                stdin=source_file,
                stdout=out,
                stderr=err,
                # a compiler that is killed leaves temporary files: here they go with the folder
                env={**os.environ, "TMPDIR": place},
                start_new_session=True,
            )
            try:
                if not wait_until(lambda: process.poll() is not None, limit):
                    raise CompilerTooSlowError(limit)
            finally:
                if process.returncode is None:
                    _end(process)
        texts = [path.read_text(encoding="utf-8", errors="replace") for path in (output, errors)]
        return Finished(process.wait(), *texts)


def has_room(folder: Path) -> None:
    """Raises OSError, which names the folder, where what a compiler makes cannot be written."""
    with naming(folder), tempfile.TemporaryFile(dir=folder, prefix=".room-") as file:
        # random bytes: file systems that compress take zeros for nothing
        file.write(os.urandom(_ROOM))


def compiler_limit() -> float:
    """Seconds after which a compiler is ended."""
    try:
        given = float(os.environ.get("MSNN_COMPILER_SECONDS", ""))
    except ValueError:
        return LIMIT
    return given if given > 0 else LIMIT


def _end(process: subprocess.Popen[bytes]) -> None:
    if sys.platform == "win32":  # which has no groups of processes
        process.kill()
    else:
        with suppress(ProcessLookupError):
            # the group: gcc is a driver, and its compiler proper would go on
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()
