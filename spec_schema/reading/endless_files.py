"""Says which files may be read, and of which the content may be quoted in messages.

A pipe waits for somebody to write, a device may never end, and `/proc` has what other programs
keep to themselves.
"""

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
_OF_SYSTEM = {("/", "proc"), ("/", "sys")}


def refuse_endless(path: Path, *, of_shell: bool = False) -> None:
    """Raises OSError for what is no file on a disk, and where there is nothing at all.

    These are a pipe, a socket, a device, and what the system shows of itself in `/proc` and `/sys`.

    `of_shell` lets the pipes in /dev pass: they are those of `<(…)` and `/dev/stdin`, and the shell
    has somebody write into them.
    """
    kind = stat.S_IFMT(path.stat().st_mode)
    if kind not in _ENDLESS:
        if path.resolve().parts[:2] in _OF_SYSTEM:
            raise OSError(errno.EINVAL, "it is made up by the system", str(path))
        return
    # the shell writes into its own pipes; another one may never be written to
    if of_shell and kind == stat.S_IFIFO and path.parts[1:2] == ("dev",):
        return
    raise OSError(errno.EINVAL, _ENDLESS[kind], str(path))


def is_near(path: str, spec: str) -> bool:
    """Whether a file that a spec names lies below the spec's folder or the working folder.

    Of others, messages quote nothing: a spec of somebody else might name a file with a password.
    """
    real = Path(path).resolve()
    # the root of a disk is nobody's folder
    return any(real.is_relative_to(home) for home in _homes(spec) if home.parent != home)


def _homes(spec: str) -> tuple[Path, Path]:
    return Path(spec).parent.resolve(), Path.cwd()
