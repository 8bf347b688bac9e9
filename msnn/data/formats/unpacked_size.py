"""Refuses archives that unpack to far more than a measurement would, before they are unpacked."""

from __future__ import annotations

from pathlib import Path

from msnn.errors.data.files import unreadable_file
from spec_schema.diagnostics.diagnostic import SpecError

FREE = 1 << 28
"""Bytes that any file may unpack to."""
TIMES_SIZE = 200
"""Real logs are packed by 20 at most, a flag that hardly changes by more."""
_MB = 1_000_000


def refuse_unpacking(
    path: Path, shown: str, unpacked: int, *, free: int = FREE, times_size: int = TIMES_SIZE
) -> None:
    """Raises SpecError (E0802) if the directory of an archive states so many bytes that it is none.

    A directory that states too few is no way out: readers take no more than it says.
    """
    size = path.stat().st_size
    if unpacked <= free or unpacked <= times_size * size:
        return
    times = unpacked // max(size, 1)
    reason = f"it unpacks to {unpacked // _MB} MB, {times} times its size: no measurement does"
    repair = "if it is one, save it without compression, or as several files"
    raise SpecError((unreadable_file(shown, reason, repair),))
