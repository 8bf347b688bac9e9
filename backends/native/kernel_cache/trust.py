"""Says who else could have put a file where it lies: what others may write is never run."""

from __future__ import annotations

import errno
import os
import stat
import sys
from pathlib import Path


def why_folder_is_not_trusted(folder: Path, *, is_above: bool = False) -> str | None:
    """The reason: who but this user and root may change files of a folder; None where nobody may.

    `folder` has no symbolic link in it (`os.path.realpath`) and exists. It and every folder above
    it belong to the user or to root and are closed to others, but for those with the sticky bit
    (`/tmp`), in which nobody can replace what belongs to somebody else. Such a one will do itself
    where it only `is_above` the folder that is meant. Raises OSError. Windows keeps the folders of
    a user's profile from others by lists that are not read here.
    """
    if sys.platform == "win32":
        return None
    for place in (folder, *folder.parents):
        # `lstat`: a link that appeared after `realpath` shows as no folder instead of being
        # followed
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
    """Whether an open file is one that only this user or root could write."""
    # of the open file: its path may lead to another one by now
    found = os.fstat(descriptor)
    if sys.platform == "win32":
        return stat.S_ISREG(found.st_mode)
    return stat.S_ISREG(found.st_mode) and _stranger(found) is None and not _others_may_write(found)


def _stranger(found: os.stat_result) -> str | None:
    """The owner, if that is neither this user nor root, who may do anything anyway."""
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
    """Whether a group is the user's private one, as systems with `umask 002` give to everybody."""
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
