"""Refuses archives that would unpack to much more data than a measurement."""

from __future__ import annotations

from pathlib import Path

from msnn.errors.data.files import unreadable_file
from spec_schema.diagnostics.diagnostic import SpecError

FREE = 1 << 28
"""Unpacked size in bytes that is always allowed."""
TIMES_SIZE = 200
"""Maximum compression ratio: real logs reach 20:1, a rarely changing flag more."""
_MB = 1_000_000


def refuse_unpacking(
    path: Path, shown: str, unpacked: int, *, free: int = FREE, times_size: int = TIMES_SIZE
) -> None:
    """Raises SpecError (E0802) if an archive's directory states an implausible unpacked size.

    Understating the size does not help an attacker: readers unpack at most the stated size.
    """
    size = path.stat().st_size
    if unpacked <= free or unpacked <= times_size * size:
        return
    times = unpacked // max(size, 1)
    reason = f"it unpacks to {unpacked // _MB} MB, {times} times its size: no measurement does"
    repair = "if it is one, save it without compression, or as several files"
    raise SpecError((unreadable_file(shown, reason, repair),))
