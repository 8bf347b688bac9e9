"""Finds steps at which one derivative is infinite while no other is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.selftest.singles.boundaries import allowed, moved
from backends.c.selftest.singles.decisions import Decisions
from backends.c.selftest.singles.drawn_trials import trials_of_kinds
from backends.c.selftest.singles.trial_steps import Trials, TrialSteps, joined_trials

Array = NDArray[Any]

_DRAWN_FINITE, _BEGUN = 4096, 16
_SHORT, _LONG = (24, 24), (96, 48)
"""Rounds of a search, and copies of each step per round."""
_NEAR = 4.0
"""Maximum remaining distance of a short search after which long searches follow."""
_TRIES = 3
_REDRAWN = 1.5
"""Average number of elements drawn again in every third copy, since moves never reach 0."""
_FARTHEST = 2000.0
"""Distance of NaN, and maximum distance, in powers of 2."""


def slopes_apart(
    steps: TrialSteps, decisions: Decisions, slopes: Sequence[int], random: np.random.Generator
) -> list[Trials]:
    """For each Jacobian entry with an index in `slopes`, the step found that is closest to making
    it the only infinite one. Empty in float64. In float32 an infinite entry does not show its
    distance from the largest float, so entries are computed in float64. The distance of a step is a
    sum, in powers of 2: the excess of all other entries over the largest float32, the shortfall of
    the entry itself, and 1 for each entry with the wrong outcome in float32. Random moves reduce
    it.
    """
    # float64 has no wider twin that could say how far beyond the largest number a slope is
    if not slopes or steps.dtype != np.float32:
        return []
    search = _Approach(steps, decisions, random)
    found: list[Trials] = []
    for slope in slopes:
        nearest, far = search.brought(slope, *_SHORT)
        for _ in range(_TRIES):
            if not 0.0 < far <= _NEAR:
                break
            nearest, far = search.brought(slope, *_LONG)
        found.append(nearest)
    return found


class _Approach:
    def __init__(
        self, steps: TrialSteps, decisions: Decisions, random: np.random.Generator
    ) -> None:
        self._steps, self._decisions, self._random = steps, decisions, random
        self._twin = steps.in_float64()
        self._largest = np.log2(float(np.finfo(steps.dtype).max))

    def brought(self, slope: int, rounds: int, copies: int) -> tuple[Trials, float]:
        """The closest step found to one at which only the Jacobian entry `slope` is infinite, and
        its distance in powers of 2 (defined in `slopes_apart`). Each of `rounds` rounds tries
        `copies` random changes of each step.
        """
        steps, random = self._steps, self._random
        drawn = trials_of_kinds(steps, np.arange(_DRAWN_FINITE) % 4, random)
        # the twin judges distances, and of NaN and ∞ there is none
        drawn = drawn.of(np.flatnonzero(np.isfinite(drawn.numbers).all(axis=1)))
        far = self._far(drawn, slope, np.full(len(drawn), np.inf))
        # stable: the same vectors on every machine, whose sorts break ties differently
        rows = np.argsort(far, kind="stable")[:_BEGUN]
        current, left = drawn.of(rows), far[rows]
        # copies of one step lie side by side, so that the best of each is found by a reshape
        of = np.repeat(np.arange(len(current)), copies)
        for turn in range(rounds):
            if left.min() == 0.0:
                break
            numbers = moved(current.numbers[of], steps, turn, rounds, random)
            fresh = trials_of_kinds(steps, np.arange(len(of)) % 4, random).numbers
            anew = random.random(fresh.shape) < _REDRAWN / steps.size
            anew &= (np.arange(len(of)) % 3 == 0)[:, np.newaxis] & np.isfinite(fresh)
            numbers = allowed(np.where(anew, fresh, numbers), steps)
            trials = Trials(current.starts[of], numbers)
            far = self._far(trials, slope, left[of])
            best = far.reshape(-1, copies).argmin(axis=1) + np.arange(len(current)) * copies
            # each step keeps its own best copy: as many paths stay apart as began
            better = far[best] < left
            left[better] = far[best[better]]
            current.numbers[better] = numbers[best[better]]
        nearest = int(left.argmin())
        return current.of(np.array([nearest])), float(left[nearest])

    def _far(self, trials: Trials, slope: int, below: Array) -> Array:
        """The distance (B,) of each step from one at which only the Jacobian entry `slope` is
        infinite, in powers of 2 (defined in `slopes_apart`). It is exact only where it is smaller
        than `below` (B,).
        """
        wide = Trials(trials.starts, trials.numbers.astype(np.float64))
        slopes = self._decisions.doubtful(self._twin.run(wide), len(wide))
        with np.errstate(divide="ignore"):
            beyond = np.log2(np.abs(slopes)) - self._largest
        beyond = np.where(np.isnan(beyond), _FARTHEST, np.clip(beyond, -_FARTHEST, _FARTHEST))
        # the one that is to be infinite is as far as it is still below the largest number
        beyond[:, slope] *= -1.0
        far = np.maximum(beyond, 0.0).sum(axis=1)
        # float32 costs a second run of the step: only where float64 promises something better
        rows = np.flatnonzero(far < below)
        if len(rows):
            part = trials.of(rows)
            wrong = ~np.isfinite(self._decisions.doubtful(self._steps.run(part), len(part)))
            wrong[:, slope] ^= True
            far[rows] += wrong.sum(axis=1)
        return far


_DRAWN, _FRESH, _ROUNDS = 4096, 256, 32
_COPIES = 48
"""Copies of the best step for each entry, with some random elements."""
_OTHERS = (1.5, 3.0, 6.0)
"""Average numbers of random elements in a copy; one is chosen per copy."""


def slopes_alone(
    steps: TrialSteps, decisions: Decisions, random: np.random.Generator
) -> list[Trials]:
    """For each Jacobian entry that can be infinite, the simplest step found at which only this
    entry is infinite. Entries without such a step are omitted. Changed parameters are for
    `linearize`; the step itself uses the trained ones. The search keeps for each entry the step
    with the fewest other infinite entries, and mutates it.
    """
    found = _DrawnSearch(steps, decisions)
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


class _DrawnSearch:
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
        """The absolute values (B, entries) of the Jacobian entries that can be infinite: those that
        are infinite or NaN while no other is; 0 for all others.
        """
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
