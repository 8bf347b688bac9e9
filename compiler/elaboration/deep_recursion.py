"""Raises Python's recursion limit for long chains of equations, which lower recursively."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager

_PER_ENTRY = 400
"""Maximum number of Python frames between an entry and an entry that its expression names."""

_BASE = 10_000
"""Frames for the surrounding code."""


@contextmanager
def room_for(entries: int) -> Generator[None]:
    """Raises the recursion limit for a chain of `entries` entries, each of which reads the next
    one.

    Python frames are on the heap, a few hundred bytes each, and the size of a spec is limited.
    """
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(max(before, _BASE + _PER_ENTRY * entries))
    try:
        yield
    finally:
        sys.setrecursionlimit(before)
