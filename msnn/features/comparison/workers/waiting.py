"""Distributes the trials of a comparison, in order or on request of new proposals."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import TypeAlias

from msnn.features.comparison.trial import Trial
from msnn.features.comparison.variants import Variant

Group: TypeAlias = "tuple[Variant, int]"
"""The folds of a variant and seed, which share loaded data."""


def group_of(trial: Trial | None) -> Group | None:
    """The group of trials that should run in the same process."""
    return None if trial is None else (trial.variant, trial.seed)


def nothing_more() -> Sequence[Trial]:
    """No further trials: all were known at the start."""
    return ()


class Waiting:
    """Trials that have not begun; `more` provides others when there are none."""

    def __init__(
        self, trials: Sequence[Trial], more: Callable[[], Sequence[Trial]] = nothing_more
    ) -> None:
        self._of: dict[Group, deque[Trial]] = {}
        self._begun: set[Group] = set()
        self._more = more
        self._add(trials)

    def __len__(self) -> int:
        """The number of known trials that have not begun."""
        return sum(map(len, self._of.values()))

    def take_together(self, last: Trial | None, most: int) -> list[Trial]:
        """At most `most` trials that share data; empty if `take` returns None."""
        found: list[Trial] = []
        while len(found) < most and (trial := self.take(found[-1] if found else last)) is not None:
            found.append(trial)
            # the group is used up: a task of two groups would read two sets of data
            if group_of(trial) not in self._of:
                break
        return found

    def take(self, last: Trial | None) -> Trial | None:
        """The next trial for a worker that had `last`: of its group, of a new group, or any.

        None if nothing remains, or if further proposals need a result first.
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
        """Returns a trial to the queue."""
        self._add((trial,))

    def _add(self, trials: Sequence[Trial]) -> None:
        for trial in trials:
            self._of.setdefault((trial.variant, trial.seed), deque()).append(trial)
