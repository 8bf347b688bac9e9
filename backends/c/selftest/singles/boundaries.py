"""Finds steps at which a comparison changes its sign, and on both sides: by bisection and by
descent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.functions.input_policy import limits
from backends.c.interface.interface import InputField
from backends.c.selftest.singles.decisions import UNORDERED, Decisions
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
    """Single steps close to a change of a decision: of the sign of a difference, or of an entry of
    the Jacobian to infinity. `below` and `above` are pairs of steps.
    """

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
    """Searches steps near and at the change of each decision, by bisection between two steps with
    different outcomes and the same start. `outcomes` gives (B, decisions): -1, 0, 1 if the left
    side is less, equal, greater, and `UNORDERED` for NaN. The ends of segments are chosen from
    `drawn`, random steps. Bisection moves all elements together, by numbers of adjacent floats in
    proportion to their distance.
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
    """Searches steps near `ends` at which both sides of a decision are equal. `decision` is the
    index of the decision for each end; `outcomes` gives the decisions of steps (B, decisions), 0 if
    both sides are equal.
    """
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
    """Pairs of steps with the same start and different outcomes of a decision: their left ends,
    right ends, and the index of the decision. `outcomes` (B, decisions) belong to `drawn`.
    """
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


Codes = NDArray[np.int64]


def codes_of(numbers: NDArray[Any]) -> Codes:
    """An integer for each float, so that adjacent floats have adjacent integers in ascending order.
    0 and -0 have 0, and negative floats negative ones.
    """
    words = np.ascontiguousarray(numbers).view(f"i{numbers.itemsize}").astype(np.int64)
    # the bits increase with the magnitude; the sign bit gives the sign of the code
    magnitudes = words & _largest(numbers.dtype)
    return np.where(words < 0, -magnitudes, magnitudes)


def numbers_of(codes: Codes, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The floats of type `dtype` with these integers, the inverse of `codes_of`."""
    words = np.abs(codes).astype(f"i{dtype.itemsize}")
    return np.copysign(words.view(dtype), np.where(codes < 0, -1.0, 1.0).astype(dtype))


def between(left: Codes, right: Codes) -> Codes:
    """The middle of two integers of `codes_of`, element-wise, rounded towards the left one."""
    # the difference of two float64 codes may overflow
    half = right // 2 - left // 2
    # close codes need the exact half, as separately rounded halves may not change
    return left + np.where(np.abs(half) > 1, half, np.trunc((right - left) / 2).astype(np.int64))


def distance(left: Codes, right: Codes) -> NDArray[np.uint64]:
    """How many floats lie from one integer of `codes_of` to the other, element-wise: 1 if
    adjacent.
    """
    # the distance of two float64 may exceed int64; the unsigned difference is exact
    return np.maximum(left, right).view(np.uint64) - np.minimum(left, right).view(np.uint64)


def _largest(dtype: np.dtype[Any]) -> int:
    return int(np.iinfo(f"i{dtype.itemsize}").max)


_BEGUN = 8
"""Number of initial steps per decision."""
_ROUNDS, _COPIES = 48, 24
_NEAR = 5e-4
"""Maximum difference at which a limit of 0.001 instead of 0 changes the result."""
_SHARES_MOVED = (0.1, 0.3, 0.6)
"""Fraction of the elements that move in a round, alternating."""
_REACH = 0.97
"""Exponent of the largest move, as a fraction of the bits of a float. In every second copy the
moves shrink from round to round."""


def descended(
    steps: TrialSteps,
    decisions: Decisions,
    drawn: Trials,
    which: NDArray[np.int64],
    random: np.random.Generator,
    held: float = 0.0,
) -> Trials:
    """Searches steps at which both sides of a decision are equal, among the decisions with indices
    `which`; returns these and some steps nearby, possibly none. A product is 0 only if both factors
    are tiny, and a sum only at few floats near its change of sign. So some steps of `drawn` take
    small and large random moves that reduce the difference of the sides, until it is 0. `held` is
    the fraction of elements of each step that do not move: otherwise the search for a small
    quotient ends with a huge divisor and an overflow.
    """
    gaps = _gaps(steps, decisions, drawn, which)
    # |x| and x are 0 at the same steps
    _, first = np.unique(gaps, axis=1, return_index=True)
    places = np.sort(first)
    which, gaps = which[places], gaps[:, places]
    rows: list[int] = []
    own: list[int] = []
    for place in range(len(which)):
        able = np.flatnonzero(np.isfinite(gaps[:, place]))
        # steps with plain numbers stand first: at them a change shows best
        chosen = [*able[: _BEGUN // 2], *random.permutation(able)[: _BEGUN // 2]]
        rows += chosen
        own += [place] * len(chosen)
    current, decision = drawn.of(np.array(rows, np.int64)), np.array(own, np.int64)
    if not len(current):
        return current
    left = gaps[rows, decision]
    near: list[Trials] = []
    moving = np.ones(current.numbers.shape, np.bool_)
    if held:
        moving = random.random(moving.shape) >= held
    for turn in range(_ROUNDS):
        open = np.flatnonzero(left > 0.0)
        if not len(open):
            break
        of = np.repeat(open, _COPIES)
        numbers = moved(current.numbers[of], steps, turn, _ROUNDS, random, moving[of])
        copies = Trials(current.starts[of], allowed(numbers, steps))
        found = _gaps(steps, decisions, copies, which)[np.arange(len(of)), decision[of]]
        best = found.reshape(-1, _COPIES).argmin(axis=1) + np.arange(len(open)) * _COPIES
        better = found[best] < left[open]
        # the move in which it comes near: each is kept once
        comes_near = (found[best] > 0.0) & (found[best] < _NEAR) & (left[open] >= _NEAR)
        near.append(copies.of(best[comes_near]))
        left[open[better]] = found[best[better]]
        current.numbers[open[better]] = copies.numbers[best[better]]
    return joined_trials([current.of(np.flatnonzero(left == 0.0)), *near])


def moved(
    numbers: Array,
    steps: TrialSteps,
    turn: int,
    turns: int,
    random: np.random.Generator,
    moving: NDArray[np.bool_] | bool = True,
) -> Array:
    """Copies of `numbers` (B, size), the values of steps, after random moves in steps of adjacent
    floats; elements with a False in `moving` stay. In round `turn` of `turns`, moves of every
    second row have become smaller.
    """
    most = np.full((len(numbers), 1), _REACH * (8 * steps.dtype.itemsize - 1))
    most[::2] *= 1.0 - turn / turns
    sizes = np.exp2(most * random.random(most.shape))
    moves = np.ceil(sizes * random.random(numbers.shape)).astype(np.int64)
    moves *= random.choice(np.array([-1, 1]), numbers.shape)
    moves *= (random.random(numbers.shape) < _SHARES_MOVED[turn % len(_SHARES_MOVED)]) & moving
    return numbers_of(_finite(codes_of(numbers) + moves, steps), steps.dtype)


def allowed(numbers: Array, steps: TrialSteps) -> Array:
    """The values `numbers` (B, size) of steps with parameters limited to the sign that the model
    requires, and inputs with policy clamp or hold limited to their valid range.
    """
    low, high = steps.bounds
    found = numbers.copy()
    found[:, steps.tuned] = np.clip(found[:, steps.tuned], low, high)
    for member, places in steps.members():
        if isinstance(member, InputField):
            signal = member.port.signal
            if signal.on_invalid in ("clamp", "hold"):
                first, last = limits(signal, steps.interface.options.dtype)
                found[:, places] = np.clip(found[:, places], first, last)
    return found


def _gaps(
    steps: TrialSteps, decisions: Decisions, trials: Trials, which: NDArray[np.int64]
) -> Array:
    """The absolute differences of both sides of the decisions `which`, (B, len(which)); infinite if
    a side is NaN.
    """
    return decisions.gaps(steps.run(trials), len(trials), which)


def _finite(codes: NDArray[np.int64], steps: TrialSteps) -> NDArray[np.int64]:
    most = int(codes_of(np.array([np.finfo(steps.dtype).max], steps.dtype))[0])
    return np.clip(codes, -most, most)
