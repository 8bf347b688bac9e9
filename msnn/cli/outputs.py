"""Prevents a command from overwriting a file that it reads or that belongs to a run."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from pathlib import Path
from stat import S_ISREG
from typing import Any, cast

import typer

_WRITES = os.O_WRONLY | os.O_RDWR


class Outputs:
    """The existing files that the running command will replace or extend.

    A usage error ends the command when it opens one of them for reading: a Python audit hook
    observes every opened file. A reader in C or in another process reports its file with
    `sys.audit("open", path, "r", os.O_RDONLY)`.
    """

    def __init__(self) -> None:
        self._files: dict[tuple[int, int], Path] = {}
        self._is_watching = False

    def __bool__(self) -> bool:
        """True if an existing file may be overwritten."""
        return bool(self._files)

    def forget(self) -> None:
        """Clears the files after a command."""
        self._files.clear()

    def protect(self, *outputs: Path) -> None:
        """Adds outputs; BadParameter for duplicates and for files of a run."""
        new = [path.absolute() for path in outputs if not path.exists()]
        if twice := [path for path in new if new.count(path) > 1]:
            raise typer.BadParameter(f"`{twice[0]}` would be written twice")
        for path in outputs:
            # neither a folder, into which much is written, nor a device or a pipe
            if (identity := _identity(path)) is None:
                continue
            if identity in self._files:
                raise typer.BadParameter(f"`{path}` would be written twice")
            if _is_of_run(path.resolve()):
                raise typer.BadParameter(f"`{path}` belongs to a run and would be overwritten")
            self._files[identity] = path
        if self._files and not self._is_watching:
            # for as long as the process lives: Python has no way to remove one
            sys.addaudithook(self._opened)
            self._is_watching = True

    def spare(self, read: Iterable[Path]) -> None:
        """BadParameter if one of these files is an output."""
        for path in read if self._files else ():
            written = self._files.get(_identity(path) or (0, 0))
            if written is not None:
                raise typer.BadParameter(f"`{written}` is read here and would be overwritten")

    def _opened(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and self._files:
            path, _, flags = arguments
            if isinstance(path, str | bytes | os.PathLike) and not flags & _WRITES:
                self.spare([Path(os.fsdecode(cast("str", path)))])


def _identity(path: Path) -> tuple[int, int] | None:
    """The device and inode of a regular file; None for other paths."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return (found.st_dev, found.st_ino) if S_ISREG(found.st_mode) else None


def _is_of_run(path: Path) -> bool:
    from msnn.model.saved_run import is_kept

    return is_kept(path)
