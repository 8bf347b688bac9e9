"""Finds steps at which both sides of a decision are equal, by a random local search."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.functions.input_policy import limits
from backends.c.interface.interface import InputField
from backends.c.selftest.singles.decisions import Decisions
from backends.c.selftest.singles.ordered_codes import codes_of, numbers_of
from backends.c.selftest.singles.trial_steps import Trials, TrialSteps, joined_trials

Array = NDArray[Any]

_BEGUN = 8
"""Number of initial steps per decision."""
_ROUNDS, _COPIES = 48, 24
_NEAR = 5e-4
"""Maximum difference at which a limit of 0.001 instead of 0 changes the result."""
_MOVED = (0.1, 0.3, 0.6)
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
    """Steps at which both sides of one of these decisions are equal, and some nearby steps.

    The result may be empty. A product is 0 only if both factors are tiny, and a sum only at few
    floats near its change of sign. So some steps of each decision take small and large moves that
    reduce the difference, until it is 0. `held` is the fraction of elements of each step that do
    not move: otherwise the search for a small quotient ends with a huge divisor and an overflow.
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
    """The elements of all steps after random moves; elements with a False in `moving` stay."""
    most = np.full((len(numbers), 1), _REACH * (8 * steps.dtype.itemsize - 1))
    most[::2] *= 1.0 - turn / turns
    sizes = np.exp2(most * random.random(most.shape))
    moves = np.ceil(sizes * random.random(numbers.shape)).astype(np.int64)
    moves *= random.choice(np.array([-1, 1]), numbers.shape)
    moves *= (random.random(numbers.shape) < _MOVED[turn % len(_MOVED)]) & moving
    return numbers_of(_finite(codes_of(numbers) + moves, steps), steps.dtype)


def allowed(numbers: Array, steps: TrialSteps) -> Array:
    """Limits parameters to the sign that the model requires, and inputs to their valid range.

    Only inputs whose policy replaces invalid values are limited.
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
    """The absolute differences of both sides of these decisions, infinite if a side is NaN."""
    return decisions.gaps(steps.run(trials), len(trials), which)


def _finite(codes: NDArray[np.int64], steps: TrialSteps) -> NDArray[np.int64]:
    most = int(codes_of(np.array([np.finfo(steps.dtype).max], steps.dtype))[0])
    return np.clip(codes, -most, most)
