"""Finds steps at which exactly one entry of the Jacobian is infinite."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.selftest.singles.decisions import Decisions
from backends.c.selftest.singles.drawn_trials import trials_of_kinds
from backends.c.selftest.singles.slopes_apart import slopes_apart
from backends.c.selftest.singles.trial_steps import Trials, TrialSteps, joined_trials

Array = NDArray[Any]

_DRAWN, _FRESH, _ROUNDS = 4096, 256, 32
_COPIES = 48
"""Copies of the best step for each entry, with some random elements."""
_OTHERS = (1.5, 3.0, 6.0)
"""Average numbers of random elements in a copy; one is chosen per copy."""


def slopes_alone(
    steps: TrialSteps, decisions: Decisions, random: np.random.Generator
) -> list[Trials]:
    """For each Jacobian entry, the simplest found step at which only this entry is infinite.

    Entries without such a step are omitted. The parameters are for `linearize`; the step itself
    uses the trained ones. The search keeps for each entry the step with the fewest other infinite
    entries, and mutates it.
    """
    found = _Search(steps, decisions)
    found.look(trials_of_kinds(steps, np.arange(_DRAWN) % 4, random, infinite=True))
    for _ in range(_ROUNDS):
        open = [slope for slope, count in found.others.items() if count]
        if not open:
            break
        copies = [_copies(steps, found.best[slope], random) for slope in open]
        fresh = trials_of_kinds(steps, np.arange(_FRESH) % 4, random, infinite=True)
        found.look(joined_trials([fresh, *copies]))
    # by a generator of its own: what was found without it stays the same
    again = random.spawn(1)[0]
    together = [slope for slope, count in found.others.items() if count]
    for trials in slopes_apart(steps, decisions, together, again):
        found.look(trials)
    plain = trials_of_kinds(steps, np.zeros(1, np.int64), random).numbers
    plain[:, steps.tuned] = steps.trained
    alone = [slope for slope, count in found.others.items() if count < 2]
    if not alone:
        return []
    # a simpler step has the same slope, so this holds of every step on the way
    before = found.alone(joined_trials([found.best[slope] for slope in alone]))
    for place in range(steps.size):
        simpler = joined_trials([found.best[slope] for slope in alone])
        simpler.numbers[:, place] = plain[0, place]
        still = found.alone(simpler)
        for row, slope in enumerate(alone):
            if np.array_equal(still[row, slope], before[row, slope], equal_nan=True):
                found.best[slope] = simpler.of(np.array([row]))
    return [found.best[slope] for slope in alone]


class _Search:
    def __init__(self, steps: TrialSteps, decisions: Decisions) -> None:
        self._steps, self._decisions = steps, decisions
        self.best: dict[int, Trials] = {}
        self.others: dict[int, int] = {}
        """For each entry, twice the number of other infinite entries in its best step, plus 1 if it
        is NaN."""

    def look(self, trials: Trials) -> None:
        sizes = self._sizes(trials)
        endless = np.isnan(sizes) | np.isinf(sizes)
        # a comparison with the largest number tells infinity only: NaN is the second choice
        others = 2 * (endless.sum(axis=1, keepdims=True) - 1) + np.isnan(sizes)
        for slope, of in enumerate(endless.T):
            rows = np.flatnonzero(of)
            if len(rows):
                row = rows[np.argmin(others[rows, slope])]
                # another step as good as the best so far may lead further
                if others[row, slope] <= self.others.get(slope, 2 * len(endless.T)):
                    self.best[slope] = trials.of(np.array([row]))
                    self.others[slope] = int(others[row, slope])

    def alone(self, trials: Trials) -> Array:
        """The absolute values of entries that alone are infinite or NaN, else 0, (B, entries)."""
        sizes = self._sizes(trials)
        endless = ~np.isfinite(sizes)
        return np.where(endless & (endless.sum(axis=1) == 1)[:, np.newaxis], np.abs(sizes), 0.0)

    def _sizes(self, trials: Trials) -> Array:
        count = len(trials)
        slopes = self._decisions.doubtful(self._steps.run(trials), count)
        settled = self._decisions.settled(self._steps.run(self._steps.with_trained(trials)), count)
        return np.where(settled[:, np.newaxis], slopes, 0.0)


def _copies(steps: TrialSteps, best: Trials, random: np.random.Generator) -> Trials:
    fresh = trials_of_kinds(steps, np.arange(_COPIES) % 4, random, infinite=True)
    share = random.choice(_OTHERS, (_COPIES, 1)) / steps.size
    other = random.random(fresh.numbers.shape) < share
    numbers = np.where(other, fresh.numbers, best.numbers)
    return Trials(np.repeat(best.starts, _COPIES), numbers)
