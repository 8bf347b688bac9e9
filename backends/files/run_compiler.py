"""Runs a compiler with a time limit, without leaving processes behind."""

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
"""Default limit in seconds, which MSNN_COMPILER_SECONDS overrides; far more than large kernels
need."""


_ROOM = 1 << 20
"""Bytes that must fit in a folder; most kernels and libraries are smaller."""


class CompilerTooSlowError(Exception):
    """A compiler exceeded its time limit and was killed."""

    remedy = "set CC to another compiler, or MSNN_COMPILER_SECONDS to the seconds that it needs"

    def __init__(self, limit: float) -> None:
        super().__init__(f"did not end within {limit:g} s")


@dataclass(frozen=True, slots=True)
class Finished:
    """A compiler that ended by itself: its exit code and its output."""

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
    """Runs the command with `source` as its input; temporary files are in `folder`.

    The limit is `compiler_limit()` seconds, or `longest` if that is less. The compiler runs in its
    own session, so Ctrl-C reaches only this process, which may want to finish its work. When
    waiting ends, the compiler and its children are killed. Raises CompilerTooSlowError,
    KeyboardInterrupt, and OSError if the command cannot start or the folder accepts no files.
    """
    limit = min(longest, compiler_limit())
    # files instead of pipes: a surviving child does not block
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
                # temporary files of a killed compiler are removed with the folder
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
    """Raises OSError, which names the folder, if a compiler's output would not fit."""
    with naming(folder), tempfile.TemporaryFile(dir=folder, prefix=".room-") as file:
        # random bytes: compressing file systems need no space for zeros
        file.write(os.urandom(_ROOM))


def compiler_limit() -> float:
    """Time limit of a compiler in seconds."""
    try:
        given = float(os.environ.get("MSNN_COMPILER_SECONDS", ""))
    except ValueError:
        return LIMIT
    return given if given > 0 else LIMIT


def _end(process: subprocess.Popen[bytes]) -> None:
    if sys.platform == "win32":  # no process groups
        process.kill()
    else:
        with suppress(ProcessLookupError):
            # the group, since gcc is a driver that starts the actual compiler
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()
