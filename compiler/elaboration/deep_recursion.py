"""Makes room on the stack for long specs: a chain of equations is lowered inside out."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager

_PER_ENTRY = 400
"""Python frames between an entry and one that it names in an expression as deep as may be."""

_BASE = 10_000
"""Frames for all that is around it."""


@contextmanager
def room_for(entries: int) -> Generator[None]:
    """Lets Python recurse through so many entries of a spec, each of which may need the next one.

    The frames are on the heap, a few hundred bytes each; the size of a spec is capped.
    """
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(max(before, _BASE + _PER_ENTRY * entries))
    try:
        yield
    finally:
        sys.setrecursionlimit(before)
