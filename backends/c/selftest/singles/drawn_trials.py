"""Draws single steps all over what states, inputs and parameters can be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.functions.input_policy import limits
from backends.c.interface.interface import InputField
from backends.c.selftest.singles.trial_steps import Trials, TrialSteps
from backends.c.selftest.vectors.drawn_inputs import drawable, knots_of
from compiler.ir.program import State

Array = NDArray[Any]

PLAIN = 64
"""Steps whose numbers are all inside their ranges; they stand first."""

_KINDS = (0, 1, 2, 3)
"""Inside the ranges; some at knots and limits; some of any size around 1; some of any size at all,
among zeros and infinities."""
_EACH = 128
"""Steps of each other kind with trained parameters, and as many with others."""
_OTHERS = 3.0
"""Parameters that are others in a step, on average; in every second step most of them."""
_SHARES = (0.25, 0.1, 0.15, 0.4, 0.1)
"""Of the kinds of parameters."""
_INFINITE = 0.1
"""Of the parameters that are others, where some may be infinite."""
_WIDE, _HUGE = (-12.0, 12.0), (-140.0, 127.99)
"""Binades."""


def drawn_trials(steps: TrialSteps, random: np.random.Generator) -> Trials:
    """Steps of every kind, from every start."""
    # plain ones, the other kinds with trained parameters, then all kinds with others
    kinds = np.repeat([*_KINDS[:1], *_KINDS[1:], *_KINDS], [PLAIN, *[_EACH] * 7])
    trials = trials_of_kinds(steps, kinds, random)
    trials.numbers[: PLAIN + 3 * _EACH, steps.tuned] = steps.trained
    return trials


def trials_of_kinds(
    steps: TrialSteps, kinds: Array, random: np.random.Generator, *, infinite: bool = False
) -> Trials:
    """Steps of these kinds with other parameters than the trained ones, some perhaps infinite."""
    count = len(kinds)
    numbers = np.zeros((count, steps.size), steps.dtype)
    for member, places in steps.members():
        shape = count, places.stop - places.start
        numbers[:, places] = _numbers(steps, member, kinds[:, np.newaxis], shape, random)
    tuned = _within(_parameters(steps.trained, count, random), steps.bounds)
    # only where a parameter is another one already
    endless = (tuned != steps.trained) & _some(tuned.shape, random, _INFINITE * infinite)
    numbers[:, steps.tuned] = np.where(endless, np.inf, tuned)
    return Trials(np.arange(count) % steps.starts, numbers)


def _numbers(
    steps: TrialSteps,
    member: State | InputField,
    kinds: Array,
    shape: tuple[int, int],
    random: np.random.Generator,
) -> Array:
    dtype = steps.interface.options.dtype
    signal = member.port.signal if isinstance(member, InputField) else None
    bounds = member.port.signal.range if isinstance(member, InputField) else member.range
    low, high = drawable(bounds)
    inside = random.uniform(low, high, shape)
    knots = [low, high, 0.0, 1.0, -1.0, *knots_of(steps.program, dtype)]
    special = np.where(_some(shape, random), random.choice(knots, shape), inside)
    wide = _any_size(_WIDE, shape, random)
    around = np.where(_some(shape, random), wide, inside)
    zeros = np.where(_some(shape, random), wide, 0.0)
    huge = np.where(_some(shape, random), _any_size(_HUGE, shape, random), zeros)
    huge = np.where(_some(shape, random, 0.05), np.inf, huge)
    numbers = np.choose(kinds, [inside, special, around, huge])
    if signal is None or signal.on_invalid not in ("clamp", "hold"):
        return numbers
    # what the policy would replace is what other golden vectors are about
    first, last = limits(signal, dtype)
    return np.clip(np.where((numbers < low) | (numbers > high), inside, numbers), first, last)


def _parameters(trained: Array, count: int, random: np.random.Generator) -> Array:
    """Some are 0, near 0, of any size or about as large as the trained number.

    In every second step there are few of them.
    """
    shape = count, len(trained)
    values = np.choose(
        random.choice(5, shape, p=_SHARES),
        [
            np.zeros(shape),
            1e-3 * random.uniform(-1.0, 1.0, shape),
            _any_size(_WIDE, shape, random),
            _any_size(_HUGE, shape, random),
            trained * random.uniform(-2.0, 2.0, shape),
        ],
    )
    few = min(0.5, _OTHERS / max(1, len(trained)))
    shares = np.where(np.arange(count) % 2 == 0, few, 0.6)[:, np.newaxis]
    return np.where(random.random(shape) < shares, values, trained)


def _within(values: Array, bounds: tuple[Array, Array]) -> Array:
    """Values beyond a bound, mirrored at it."""
    low, high = bounds
    with np.errstate(invalid="ignore"):  # of infinite bounds, where nothing is beyond
        mirrored = np.where(values < low, 2 * low - values, 2 * high - values)
    beyond = (values < low) | (values > high)
    return np.where(beyond, np.clip(mirrored, low, high), values)


def _some(shape: tuple[int, ...], random: np.random.Generator, share: float = 0.5) -> Array:
    return random.random(shape) < share


def _any_size(
    binades: tuple[float, float], shape: tuple[int, ...], random: np.random.Generator
) -> Array:
    sign = np.where(_some(shape, random), 1.0, -1.0)
    return sign * np.exp2(random.uniform(*binades, shape))
