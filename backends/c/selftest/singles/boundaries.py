"""Finds steps on both sides of decisions: segments between two steps are halved to neighbours."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.selftest.singles.decisions import UNORDERED
from backends.c.selftest.singles.ordered_codes import between, codes_of, numbers_of
from backends.c.selftest.singles.trial_steps import Trials, TrialSteps

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


def boundaries(
    steps: TrialSteps,
    outcomes: Callable[[Trials], Outcomes],
    drawn: Trials,
    random: np.random.Generator,
) -> Iterator[Trials]:
    """Steps near, next to and at the places where an outcome (B, decisions) changes.

    Both ends of a segment have the same start. In between all numbers move together, as far in the
    order of the numbers of their type.
    """
    first = outcomes(drawn)
    left, right, decision = _segments(first, drawn, random)
    if not len(decision):
        return
    rows = np.arange(len(decision))
    side = outcomes(left)[rows, decision]
    low, high = codes_of(left.numbers), codes_of(right.numbers)

    def trials(codes: Array, chosen: Array) -> Trials:
        return Trials(left.starts[chosen], numbers_of(codes[chosen], steps.dtype))

    for _ in range(8 * steps.dtype.itemsize + 1):
        apart = np.abs(high - low).max(axis=1)
        middle = between(low, high)
        here = outcomes(trials(middle, rows))[rows, decision]
        yield trials(middle, here == 0)
        stays = (here == side)[:, np.newaxis]
        low, high = np.where(stays, middle, low), np.where(stays, high, middle)
        for digits in _APART:
            now = (apart > 2**digits) & (np.abs(high - low).max(axis=1) <= 2**digits)
            yield trials(low, now)
            yield trials(high, now)
    yield trials(low, rows)
    yield trials(high, rows)
    for _ in range(_AROUND):
        beside = trials(low + random.integers(-_BESIDE, _BESIDE + 1, low.shape), rows)
        yield beside.of(outcomes(beside)[rows, decision] == 0)


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
                a = random.choice(below)
                others = above[drawn.starts[above] == drawn.starts[a]]
                if len(others):
                    # steps with plain numbers stand first
                    b = others[0] if number == 0 else random.choice(others)
                    found.append((a, b, decision))
                    break
    table = np.array(found, np.int64).reshape(-1, 3)
    return drawn.of(table[:, 0]), drawn.of(table[:, 1]), table[:, 2]
