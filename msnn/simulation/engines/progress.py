"""Tells whoever waits for rollouts how far they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

RolloutProgress: TypeAlias = Callable[[int, int], None]
"""Is told now and then how many steps are done, and of how many."""


def nobody(done: int, total: int) -> None:
    """Waits for nothing."""
    del done, total


class Count:
    """Adds up the steps that engines do."""

    def __init__(self, progress: RolloutProgress, total: int) -> None:
        self._progress, self._done, self._total = progress, 0, total

    def advance(self, steps: int) -> None:
        """So many more are done; those that the interpreter judges again count once more."""
        self._done += steps
        # never more done than there is
        self._progress(self._done, max(self._done, self._total))
