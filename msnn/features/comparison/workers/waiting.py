"""Hands out the trials of a comparison, in their order or as results ask for more."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import TypeAlias

from msnn.features.comparison.trial import Trial
from msnn.features.comparison.variants import Variant

Group: TypeAlias = "tuple[Variant, int]"
"""The folds of a variant and seed, which share what a process has read."""


def group_of(trial: Trial | None) -> Group | None:
    """The trials that go to the same process if they can."""
    return None if trial is None else (trial.variant, trial.seed)


def nothing_more() -> Sequence[Trial]:
    """All trials were known from the start."""
    return ()


class Waiting:
    """Trials that have not begun; `more` gives others when there are none."""

    def __init__(
        self, trials: Sequence[Trial], more: Callable[[], Sequence[Trial]] = nothing_more
    ) -> None:
        self._of: dict[Group, deque[Trial]] = {}
        self._begun: set[Group] = set()
        self._more = more
        self._add(trials)

    def __len__(self) -> int:
        """The number of trials that are known and have not begun."""
        return sum(map(len, self._of.values()))

    def take_together(self, last: Trial | None, most: int) -> list[Trial]:
        """`most` that share what a process reads, or as many as there are; none as of `take`."""
        found: list[Trial] = []
        while len(found) < most and (trial := self.take(found[-1] if found else last)) is not None:
            found.append(trial)
            # the group is used up: a task of two groups would read two sets of data
            if group_of(trial) not in self._of:
                break
        return found

    def take(self, last: Trial | None) -> Trial | None:
        """The next one for who had `last`: of the same folds, of none that has begun, or any.

        None where nothing is to do, or nothing before a result is known.
        """
        if not self._of:
            self._add(self._more())
        if not self._of:
            return None
        group = group_of(last)
        if group is None or group not in self._of:
            # a group of its own for each process as long as there are such; then helping one that
            # has begun
            fresh = (each for each in self._of if each not in self._begun)
            group = next(fresh, None) or next(iter(self._of))
        self._begun.add(group)
        found = self._of[group].popleft()
        if not self._of[group]:
            del self._of[group]
        return found

    def put_back(self, trial: Trial) -> None:
        """One that is to begin again."""
        self._add((trial,))

    def _add(self, trials: Sequence[Trial]) -> None:
        for trial in trials:
            self._of.setdefault((trial.variant, trial.seed), deque()).append(trial)
