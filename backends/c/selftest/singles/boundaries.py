"""Finds steps on both sides of decisions: segments between two steps are halved to neighbours."""

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
"""For each decision."""
_TRIES = 12
_APART = (14, 8)
"""Binary digits by which the ends of segments differ where they are kept on the way."""
_BESIDE = 6
"""Numbers around the ends among which one may be found at which two sides are equal."""
_AROUND = 8
_LONGER = 24
"""Rounds of `_AT_ONCE` steps each around every end where no two sides were equal yet: a sum of
products hits 0 at few of the numbers beside the place where its sign changes."""
_AT_ONCE = 16
_MOVED = (0.1, 0.3, 1.0)
"""Shares of the numbers that move beside an end, by turns."""
_ENOUGH = 4
"""Steps at which two sides of a decision are equal."""


@dataclass(frozen=True, slots=True)
class Boundaries:
    """Steps near places where an outcome changes."""

    found: list[Trials]
    """All, some of them next to such a place and some at it."""
    equal: Trials
    """Few steps of each decision at which both sides are equal, which is rare."""
    below: Trials
    above: Trials
    """Pairs of steps a little apart that decide otherwise."""


def boundaries(
    steps: TrialSteps,
    outcomes: Callable[[Trials], Outcomes],
    drawn: Trials,
    random: np.random.Generator,
) -> Boundaries:
    """Steps near, next to and at the places where an outcome (B, decisions) changes.

    Both ends of a segment have the same start. In between all numbers move together, as far in the
    order of the numbers of their type.
    """
    left, right, decision = _segments(outcomes(drawn), drawn, random)
    rows = np.arange(len(decision))
    if not len(rows):
        return Boundaries([], left, left, right)
    side = outcomes(left)[rows, decision]
    # integers in the order of the numbers: a middle has as many numbers on both sides
    low, high = codes_of(left.numbers), codes_of(right.numbers)
    found: list[Trials] = []
    pairs: list[tuple[Trials, Trials]] = []

    def trials(codes: Array, chosen: Array) -> Trials:
        return Trials(left.starts[chosen], numbers_of(codes[chosen], steps.dtype))

    # distances are below two to the bits of a code: so many halvings make neighbours of the ends
    for _ in range(8 * steps.dtype.itemsize + 1):
        apart = distance(low, high).max(axis=1)
        middle = between(low, high)
        here = outcomes(trials(middle, rows))[rows, decision]
        found.append(trials(middle, here == 0))
        # the left end stays on its side; equality counts as the other one
        stays = (here == side)[:, np.newaxis]
        low, high = np.where(stays, middle, low), np.where(stays, high, middle)
        for digits in _APART:
            # in this turn the segment has become shorter than that
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
    """Steps beside these ends at which the sides of their decisions are equal."""
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
    """Pairs of steps between which an outcome changes, and of which decision it is."""
    found: list[tuple[int, int, int]] = []
    for decision, of in enumerate(outcomes.T):
        below, above = np.flatnonzero(of == -1), np.flatnonzero(of == 1)
        if not (len(below) and len(above)):
            # never on one of the sides: from where both are equal
            below, above = np.flatnonzero(of == 0), np.flatnonzero((of != 0) & (of != UNORDERED))
        if not (len(below) and len(above)):
            continue
        for number in range(_SEGMENTS):
            for _ in range(_TRIES):
                # steps with plain numbers stand first
                a = below[0] if number == 0 else random.choice(below)
                others = above[drawn.starts[above] == drawn.starts[a]]
                if len(others):
                    b = others[0] if number == 0 else random.choice(others)
                    found.append((a, b, decision))
                    break
    table = np.array(found, np.int64).reshape(-1, 3)
    return drawn.of(table[:, 0]), drawn.of(table[:, 1]), table[:, 2]
