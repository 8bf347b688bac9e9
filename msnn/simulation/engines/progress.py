"""Reports the progress of rollouts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

RolloutProgress: TypeAlias = Callable[[int, int], None]
"""Callback with the number of completed steps and the total."""


def nobody(done: int, total: int) -> None:
    """Ignores progress."""
    del done, total


class Count:
    """Sums the completed steps of engines."""

    def __init__(self, progress: RolloutProgress, total: int) -> None:
        self._progress, self._done, self._total = progress, 0, total

    def advance(self, steps: int) -> None:
        """Adds completed steps; steps that the interpreter repeats count again."""
        self._done += steps
        # never more done than there is
        self._progress(self._done, max(self._done, self._total))
