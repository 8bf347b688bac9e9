"""Finds steps on both sides of decisions: segments between two steps are halved to neighbours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.selftest.singles.decisions import UNORDERED
from backends.c.selftest.singles.ordered_codes import between, codes_of, numbers_of
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


@dataclass(frozen=True, slots=True)
class Boundaries:
    """Steps near places where an outcome changes."""

    found: list[Trials]
    """All, some of them next to such a place and some at it."""
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
        return Boundaries([], left, right)
    side = outcomes(left)[rows, decision]
    low, high = codes_of(left.numbers), codes_of(right.numbers)
    found: list[Trials] = []
    pairs: list[tuple[Trials, Trials]] = []

    def trials(codes: Array, chosen: Array) -> Trials:
        return Trials(left.starts[chosen], numbers_of(codes[chosen], steps.dtype))

    for _ in range(8 * steps.dtype.itemsize + 1):
        apart = np.abs(high - low).max(axis=1)
        middle = between(low, high)
        here = outcomes(trials(middle, rows))[rows, decision]
        found.append(trials(middle, here == 0))
        stays = (here == side)[:, np.newaxis]
        low, high = np.where(stays, middle, low), np.where(stays, high, middle)
        for digits in _APART:
            now = (apart > 2**digits) & (np.abs(high - low).max(axis=1) <= 2**digits)
            found += [trials(low, now), trials(high, now)]
            if digits == _APART[0]:
                pairs.append((trials(low, now), trials(high, now)))
    found += [trials(low, rows), trials(high, rows)]
    for _ in range(_AROUND):
        beside = trials(low + random.integers(-_BESIDE, _BESIDE + 1, low.shape), rows)
        found.append(beside.of(outcomes(beside)[rows, decision] == 0))
    below, above = (joined_trials([pair[side] for pair in pairs]) for side in (0, 1))
    return Boundaries(found, below, above)


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
