"""Finds steps on both sides of a decision by bisection between two steps, down to adjacent
floats.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.selftest.singles.decisions import UNORDERED
from backends.c.selftest.singles.ordered_codes import (
    between,
    codes_of,
    distance,
    numbers_of,
)
from backends.c.selftest.singles.trial_steps import Trials, TrialSteps, joined_trials

Array = NDArray[Any]
Outcomes = NDArray[np.int8]

_SEGMENTS = 3
"""Segments per decision."""
_TRIES = 12
_APART = (14, 8)
"""Distances, in binary digits, at which the ends of a segment are also kept."""
_BESIDE = 6
"""Maximum distance in floats around the ends, where both sides of a decision may be equal."""
_AROUND = 8
_LONGER = 24
"""Rounds of `_AT_ONCE` steps around every end without equal sides so far. A sum of products is
exactly 0 at few of the floats near its change of sign."""
_AT_ONCE = 16
_MOVED = (0.1, 0.3, 1.0)
"""Fractions of the elements that change near an end, alternating."""
_ENOUGH = 4
"""Number of steps per decision with equal sides."""


@dataclass(frozen=True, slots=True)
class Boundaries:
    """Steps near changes of an outcome."""

    found: list[Trials]
    """All steps, near or at such a change."""
    equal: Trials
    """A few steps per decision with equal sides, which are rare."""
    below: Trials
    above: Trials
    """Pairs of close steps with different decisions."""


def boundaries(
    steps: TrialSteps,
    outcomes: Callable[[Trials], Outcomes],
    drawn: Trials,
    random: np.random.Generator,
) -> Boundaries:
    """Steps near and at the changes of an outcome (B, decisions).

    Both ends of a segment have the same start. Bisection moves all elements together, by the same
    number of floats in proportion.
    """
    left, right, decision = _segments(outcomes(drawn), drawn, random)
    rows = np.arange(len(decision))
    if not len(rows):
        return Boundaries([], left, left, right)
    side = outcomes(left)[rows, decision]
    # integers in the order of floats: the middle has as many floats on both sides
    low, high = codes_of(left.numbers), codes_of(right.numbers)
    found: list[Trials] = []
    pairs: list[tuple[Trials, Trials]] = []

    def trials(codes: Array, chosen: Array) -> Trials:
        return Trials(left.starts[chosen], numbers_of(codes[chosen], steps.dtype))

    # after this many halvings the ends are adjacent floats
    for _ in range(8 * steps.dtype.itemsize + 1):
        apart = distance(low, high).max(axis=1)
        middle = between(low, high)
        here = outcomes(trials(middle, rows))[rows, decision]
        found.append(trials(middle, here == 0))
        # the left end stays on its side; equality counts as the other side
        stays = (here == side)[:, np.newaxis]
        low, high = np.where(stays, middle, low), np.where(stays, high, middle)
        for digits in _APART:
            # the segment became shorter than this in this iteration
            now = (apart > 2**digits) & (distance(low, high).max(axis=1) <= 2**digits)
            found += [trials(low, now), trials(high, now)]
            if digits == _APART[0]:
                pairs.append((trials(low, now), trials(high, now)))
    found += [trials(low, rows), trials(high, rows)]
    for _ in range(_AROUND):
        beside = trials(low + random.integers(-_BESIDE, _BESIDE + 1, low.shape), rows)
        found.append(beside.of(outcomes(beside)[rows, decision] == 0))
    equal = _equal(outcomes, trials(low, rows), decision, steps.dtype, random)
    below, above = (joined_trials([pair[side] for pair in pairs]) for side in (0, 1))
    return Boundaries(found, equal, below, above)


def _equal(
    outcomes: Callable[[Trials], Outcomes],
    ends: Trials,
    decision: NDArray[np.int64],
    dtype: np.dtype[Any],
    random: np.random.Generator,
) -> Trials:
    """Steps near these ends at which the sides of their decisions are equal."""
    found, counts = [ends.of(np.zeros(0, np.int64))], np.zeros(decision.max() + 1, np.int64)
    codes = codes_of(ends.numbers)
    for turn in range(_LONGER):
        rows = np.repeat(np.flatnonzero(counts[decision] < _ENOUGH), _AT_ONCE)
        if not len(rows):
            break
        moves = random.integers(-_BESIDE, _BESIDE + 1, (len(rows), codes.shape[1]))
        moves *= random.random(moves.shape) < _MOVED[turn % len(_MOVED)]
        beside = Trials(ends.starts[rows], numbers_of(codes[rows] + moves, dtype))
        hits = np.flatnonzero(outcomes(beside)[np.arange(len(rows)), decision[rows]] == 0)
        for which in np.unique(decision[rows[hits]]):
            own = hits[decision[rows[hits]] == which][: _ENOUGH - counts[which]]
            counts[which] += len(own)
            found.append(beside.of(own))
    return joined_trials(found)


def _segments(
    outcomes: Outcomes, drawn: Trials, random: np.random.Generator
) -> tuple[Trials, Trials, NDArray[np.int64]]:
    """Pairs of steps with different outcomes, and the index of the decision."""
    found: list[tuple[int, int, int]] = []
    for decision, of in enumerate(outcomes.T):
        below, above = np.flatnonzero(of == -1), np.flatnonzero(of == 1)
        if not (len(below) and len(above)):
            # one side never occurs: use steps with equal sides
            below, above = np.flatnonzero(of == 0), np.flatnonzero((of != 0) & (of != UNORDERED))
        if not (len(below) and len(above)):
            continue
        for number in range(_SEGMENTS):
            for _ in range(_TRIES):
                # steps with plain values come first
                a = below[0] if number == 0 else random.choice(below)
                others = above[drawn.starts[above] == drawn.starts[a]]
                if len(others):
                    b = others[0] if number == 0 else random.choice(others)
                    found.append((a, b, decision))
                    break
    table = np.array(found, np.int64).reshape(-1, 3)
    return drawn.of(table[:, 0]), drawn.of(table[:, 1]), table[:, 2]
