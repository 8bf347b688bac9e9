"""Decides if other users could have written a file: such files are never executed."""

from __future__ import annotations

import errno
import os
import stat
import sys
from pathlib import Path


def why_folder_is_not_trusted(folder: Path, *, is_above: bool = False) -> str | None:
    """The reason why others can change files of a folder; None if only this user and root can.

    `folder` exists and has no symbolic link in it (`os.path.realpath`). It and its parents must
    belong to the user or root and be closed to others. Parents with the sticky bit (`/tmp`) are
    allowed, since nobody can replace files of other users there; with `is_above` also the folder
    itself. Raises OSError. Windows protects the user's profile by access lists, which are not
    checked here.
    """
    if sys.platform == "win32":
        return None
    for place in (folder, *folder.parents):
        # `lstat`: a link created after `realpath` is not followed
        found = place.lstat()
        if not stat.S_ISDIR(found.st_mode):
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(place))
        stranger = _stranger(found)
        if stranger is not None:
            return f"{place} belongs to {stranger}"
        sticky = bool(found.st_mode & stat.S_ISVTX) and (is_above or place != folder)
        if not sticky and _others_may_write(found):
            return f"others may write to {place}"
    return None


def is_trusted_file(descriptor: int) -> bool:
    """True if only this user or root can write the open file."""
    # the open file, since its path may be another file by now
    found = os.fstat(descriptor)
    if sys.platform == "win32":
        return stat.S_ISREG(found.st_mode)
    return stat.S_ISREG(found.st_mode) and _stranger(found) is None and not _others_may_write(found)


def _stranger(found: os.stat_result) -> str | None:
    """The owner, unless it is this user or root."""
    if found.st_uid in (os.geteuid(), 0):
        return None
    import pwd  # of POSIX alone

    try:
        return pwd.getpwuid(found.st_uid).pw_name
    except KeyError:
        return f"the user {found.st_uid}"


def _others_may_write(found: os.stat_result) -> bool:
    if found.st_mode & stat.S_IWOTH:
        return True
    return bool(found.st_mode & stat.S_IWGRP) and not _is_group_of_the_user_alone(found.st_gid)


def _is_group_of_the_user_alone(group: int) -> bool:
    """True for the user's private group, as on systems with `umask 002`."""
    import grp
    import pwd

    try:
        user, members = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return (
        user.pw_gid == group
        and members.gr_name == user.pw_name
        and set(members.gr_mem) <= {user.pw_name}
    )
