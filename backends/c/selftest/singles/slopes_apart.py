"""Moves steps to where one Jacobian entry is infinite and all others are finite."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.selftest.singles.decisions import Decisions
from backends.c.selftest.singles.descent import allowed, moved
from backends.c.selftest.singles.drawn_trials import trials_of_kinds
from backends.c.selftest.singles.trial_steps import Trials, TrialSteps

Array = NDArray[Any]

_DRAWN, _BEGUN = 4096, 16
_SHORT, _LONG = (24, 24), (96, 48)
"""Rounds of a search, and copies of each step per round."""
_NEAR = 4.0
"""Maximum remaining distance of a short search after which long searches follow."""
_TRIES = 3
_FRESH = 1.5
"""Average number of elements drawn again in every third copy, since moves never reach 0."""
_FARTHEST = 2000.0
"""Distance of NaN, and maximum distance, in powers of 2."""


def slopes_apart(
    steps: TrialSteps, decisions: Decisions, slopes: Sequence[int], random: np.random.Generator
) -> list[Trials]:
    """For each of these Jacobian entries, the step closest to making it the only infinite one.

    In float32 an infinite entry does not show its distance from the largest float, so entries are
    computed in float64. The distance of a step is a sum, in powers of 2. It adds the excess of all
    other entries over the largest float32, the shortfall of the entry itself, and 1 for each entry
    with the wrong outcome in float32. Random moves reduce the distance.
    """
    # float64 has no wider twin that could say how far beyond the largest number a slope is
    if not slopes or steps.dtype != np.float32:
        return []
    search = _Search(steps, decisions, random)
    found: list[Trials] = []
    for slope in slopes:
        nearest, far = search.brought(slope, *_SHORT)
        for _ in range(_TRIES):
            if not 0.0 < far <= _NEAR:
                break
            nearest, far = search.brought(slope, *_LONG)
        found.append(nearest)
    return found


class _Search:
    def __init__(
        self, steps: TrialSteps, decisions: Decisions, random: np.random.Generator
    ) -> None:
        self._steps, self._decisions, self._random = steps, decisions, random
        self._twin = steps.in_float64()
        self._largest = np.log2(float(np.finfo(steps.dtype).max))

    def brought(self, slope: int, rounds: int, copies: int) -> tuple[Trials, float]:
        """The closest step found, and its distance."""
        steps, random = self._steps, self._random
        drawn = trials_of_kinds(steps, np.arange(_DRAWN) % 4, random)
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
            anew = random.random(fresh.shape) < _FRESH / steps.size
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
        """The distance of each step; it is exact only where it is smaller than `below`."""
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
