"""Refuses to read what is no file: a pipe waits for somebody to write, a device may never end."""

from __future__ import annotations

import errno
import stat
from pathlib import Path

_ENDLESS = {
    stat.S_IFIFO: "it is a pipe, not a file",
    stat.S_IFSOCK: "it is a socket, not a file",
    stat.S_IFCHR: "it is a device, not a file",
    stat.S_IFBLK: "it is a device, not a file",
}


def refuse_endless(path: Path, *, of_shell: bool = False) -> None:
    """Raises OSError for a pipe, a socket or a device, and where there is nothing at all.

    `of_shell` lets the pipes in /dev pass: they are those of `<(…)` and `/dev/stdin`, and the shell
    has somebody write into them.
    """
    kind = stat.S_IFMT(path.stat().st_mode)
    # the shell writes into its own pipes; another one may never be written to
    if kind not in _ENDLESS or (of_shell and kind == stat.S_IFIFO and path.parts[1:2] == ("dev",)):
        return
    raise OSError(errno.EINVAL, _ENDLESS[kind], str(path))
