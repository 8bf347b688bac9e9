"""Finds a C compiler on this machine, runs it with a time limit, and extracts its errors."""

from __future__ import annotations

import importlib.util
import math
import os
import re
import shlex
import shutil
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

_COMPILERS = ("gcc", "clang", "cc")


class CompilerMissingError(Exception):
    """This machine has no C compiler that is found and works. The message has the reason and a
    suggestion (`remedy`).
    """

    def __init__(
        self,
        why: str = "no C compiler found",
        remedy: str = "install gcc, clang or the Python package ziglang, or set CC",
    ) -> None:
        super().__init__(f"{why}: {remedy}")


def find_compiler() -> tuple[str, ...]:
    """The command of the C compiler, as words: the environment variable CC, else gcc, clang or cc,
    else the compiler of the wheel `ziglang`. Raises CompilerMissingError, also for a CC that does
    not exist.
    """
    try:
        chosen = words_of(os.environ.get("CC", ""), on_windows=os.name == "nt")
    except ValueError as error:
        why = f"`CC` cannot be split into words ({error})"
        raise CompilerMissingError(why, "write it as in a shell, quotation marks closed") from None
    if chosen:
        if shutil.which(chosen[0]) is None:
            raise CompilerMissingError
        return tuple(chosen)
    for name in _COMPILERS:
        found = shutil.which(name)
        if found is not None:
            return (found,)
    zig = zig_program()
    if zig is not None:
        return (str(zig), "cc")
    raise CompilerMissingError


def words_of(command: str, *, on_windows: bool) -> list[str]:
    """The words of a command as a shell splits them; with `on_windows` a backslash is part of a
    path. Raises ValueError for an open quotation mark.
    """
    words = shlex.split(command, posix=not on_windows)
    return [word.strip('"') for word in words] if on_windows else words


def zig_program() -> Path | None:
    """The path of the program in the wheel `ziglang`; None if it is not installed. It is started by
    its path: `python -m ziglang` would first run a `ziglang.py` in the working folder.
    """
    wheel = importlib.util.find_spec("ziglang")
    if wheel is None or wheel.origin is None:
        return None
    program = Path(wheel.origin).parent / ("zig.exe" if os.name == "nt" else "zig")
    return program if program.is_file() else None


def installed_as(compiler: tuple[str, ...]) -> tuple[int, ...]:
    """Numbers that identify the executable of a compiler command, and change when another one is
    installed under its name; empty if it does not exist.
    """
    found = shutil.which(compiler[0])
    if found is None:
        return ()
    status = Path(found).stat()
    return status.st_ino, status.st_size, status.st_mtime_ns


_CLOSING = re.compile(
    r"collect2: error: ld returned|linker command failed|compilation terminated"
    r"|^\d+ (?:error|warning)s?\b|process exited with code"
)
"""Lines that only report that an earlier line was a failure."""
_NAMED = re.compile(r"\berror:", re.IGNORECASE)
_ASIDE = re.compile(
    r"\b(?:warning|note):|\bin function\b.*:$|^In file included from|^\s+(?:from |\||\d+ \|)",
    re.IGNORECASE,
)


def complaints(output: str) -> list[str]:
    """The lines of a compiler's output that name an error, otherwise all lines except warnings; the
    first is the cause. A linker writes no `error:` before missing symbols; the compiler that called
    it writes one after them. The list is empty if nothing else remains, as on a full disk.
    """
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    said = [line for line in lines if not _CLOSING.search(line)]
    for chosen in (
        [line for line in said if _NAMED.search(line)],
        [line for line in said if not _ASIDE.search(line)],
    ):
        if chosen:
            return chosen
    return []


LIMIT = 600.0
"""Default limit in seconds, which MSNN_COMPILER_SECONDS overrides; far more than large kernels
need."""


_ROOM = 1 << 20
"""Bytes that must fit in a folder; most kernels and libraries are smaller."""


class CompilerTooSlowError(Exception):
    """A compiler exceeded its time limit and was killed. The message has the limit in seconds;
    `remedy` is a suggestion.
    """

    remedy = "set CC to another compiler, or MSNN_COMPILER_SECONDS to the seconds that it needs"

    def __init__(self, limit: float) -> None:
        super().__init__(f"did not end within {limit:g} s")


@dataclass(frozen=True, slots=True)
class Finished:
    """The result of a compiler that ended by itself: exit code, standard output, and standard error
    as `errors`.
    """

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
    """Runs the command with `source` as its standard input, and returns its exit code and output.
    Temporary files are in `folder` (None: that of the system).

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
    """Raises OSError, which names the folder, if a file of 1 MB cannot be written to it."""
    with naming(folder), tempfile.TemporaryFile(dir=folder, prefix=".room-") as file:
        # random bytes: compressing file systems need no space for zeros
        file.write(os.urandom(_ROOM))


def compiler_limit() -> float:
    """The time limit of a compiler in seconds: the environment variable MSNN_COMPILER_SECONDS if it
    is a positive number, otherwise `LIMIT`.
    """
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
