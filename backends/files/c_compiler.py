"""Finds a C compiler on this machine."""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
from pathlib import Path

_COMPILERS = ("gcc", "clang", "cc")


class CompilerMissingError(Exception):
    """This machine has no known working C compiler; `remedy` is a suggestion."""

    def __init__(
        self,
        why: str = "no C compiler found",
        remedy: str = "install gcc, clang or the Python package ziglang, or set CC",
    ) -> None:
        super().__init__(f"{why}: {remedy}")


def find_compiler() -> tuple[str, ...]:
    """The command: the words of `CC`, else gcc, clang or cc, else the compiler of the wheel
    `ziglang`.

    Raises CompilerMissingError.
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
    """The words of a command; on Windows a backslash is part of a path."""
    words = shlex.split(command, posix=not on_windows)
    return [word.strip('"') for word in words] if on_windows else words


def zig_program() -> Path | None:
    """The program in the wheel `ziglang`; None if it is not installed.

    It is started by its path: `python -m ziglang` would first run a `ziglang.py` in the working
    folder.
    """
    wheel = importlib.util.find_spec("ziglang")
    if wheel is None or wheel.origin is None:
        return None
    program = Path(wheel.origin).parent / ("zig.exe" if os.name == "nt" else "zig")
    return program if program.is_file() else None


def installed_as(compiler: tuple[str, ...]) -> tuple[int, ...]:
    """Numbers that change when another compiler is installed under this name."""
    found = shutil.which(compiler[0])
    if found is None:
        return ()
    status = Path(found).stat()
    return status.st_ino, status.st_size, status.st_mtime_ns
