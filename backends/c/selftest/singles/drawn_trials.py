"""Draws random single steps from the whole space of states, inputs and parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.functions.input_policy import limits
from backends.c.interface.interface import InputField
from backends.c.selftest.drawn_inputs import drawable, knots_of
from backends.c.selftest.singles.trial_steps import Trials, TrialSteps
from compiler.ir.program import State

Array = NDArray[Any]

PLAIN = 64
"""Number of steps with all values inside their ranges; they come first."""

_KINDS = (0, 1, 2, 3)
"""Kinds of steps: inside the ranges; partly at knots and limits; partly of magnitudes around 1;
partly of any magnitude, with zeros and infinities."""
_EACH = 128
"""Number of steps of each other kind with trained parameters, and of each kind with changed
ones."""
_OTHERS = 3.0
"""Average number of changed parameters in a step; in every second step most parameters change."""
_SHARES = (0.25, 0.1, 0.15, 0.4, 0.1)
"""Probability of each kind of changed parameter."""
_INFINITE = 0.1
"""Probability that a changed parameter is infinite, if infinite ones are allowed."""
_WIDE, _HUGE = (-12.0, 12.0), (-140.0, 127.99)
"""Exponents of 2."""


def drawn_trials(steps: TrialSteps, random: np.random.Generator) -> Trials:
    """Random single steps of every kind, in turn from every start: first `PLAIN` ones inside all
    ranges, then the other kinds, each with trained parameters, then all kinds with changed
    parameters.
    """
    # plain ones, the other kinds with trained parameters, then all kinds with others
    kinds = np.repeat([*_KINDS[:1], *_KINDS[1:], *_KINDS], [PLAIN, *[_EACH] * 7])
    trials = trials_of_kinds(steps, kinds, random)
    trials.numbers[: PLAIN + 3 * _EACH, steps.tuned] = steps.trained
    return trials


def trials_of_kinds(
    steps: TrialSteps, kinds: Array, random: np.random.Generator, *, infinite: bool = False
) -> Trials:
    """Random steps of these kinds (0 … 3, see `_KINDS`), with changed parameters. With `infinite`,
    some of the changed parameters are ∞.
    """
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
    """`count` rows of parameters, (count, len(trained)): some replaced by 0, a value near 0, one of
    any magnitude, or one similar to the trained value. In every second row only a few are replaced.
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
    """The values with those outside a bound (low, high) mirrored at it, and clipped if they leave
    the other bound then.
    """
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
