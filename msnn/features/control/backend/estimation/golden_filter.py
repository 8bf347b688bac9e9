"""Draws the samples that a filter's self-test filters, and has the filter in Python judge them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.c_language.literals import Dtype
from compiler.ir.types import Type
from msnn.features.control.kalman.kalman_filter import KalmanFilter
from msnn.features.control.problem.state_estimation.problem import EstimationProblem

STEPS = 24
_MISSING = 0.2
"""Part of the measured numbers that are NaN."""
_ROUNDED = 30.0
"""How much more than single precision moves the filter in Python another order of sums may move
that of C; the covariance is kept in another form there."""
_LEAST = 64.0
"""Of machine epsilon, by the largest magnitude."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GoldenStep:
    """The measurements and inputs of a sample, and the estimate after them."""

    measured: tuple[float, ...]
    """By the order of the measurements; NaN is what was not."""
    given: tuple[float, ...]
    """All inputs, at this sample."""
    corrected: int
    predicted: int
    x: tuple[float, ...]
    std: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class GoldenSteps:
    """Steps one after the other, and how near to them a filter in C has to be."""

    start: tuple[float, ...]
    """States that reset is given."""
    steps: tuple[GoldenStep, ...]
    near: tuple[float, ...]
    near_std: tuple[float, ...]
    largest: tuple[float, ...]
    largest_std: tuple[float, ...]
    """Magnitudes along the steps."""


def golden_steps(
    problem: EstimationProblem, weights: Mapping[str, ArrayLike], dtype: Dtype, seed: int = 0
) -> GoldenSteps:
    """Steps from a drawn state; the same numbers in both precisions.

    How near is a question of how much rounding moves the problem: the filter in Python is run in
    single precision too, and what that moves counts by the machine epsilon of `dtype`.
    """
    judge = KalmanFilter(problem, weights)
    single = KalmanFilter(problem, weights, np.float32)
    random = np.random.default_rng(seed)
    start = _start(judge, random)
    ranges = {signal.name: signal.range for signal in problem.program.signals}
    # both begin alike, at numbers that both precisions have
    for each in (judge, single):
        each.reset(_named(judge, start))
    steps: list[GoldenStep] = []
    moved: list[tuple[Array, Array]] = []
    for _ in range(STEPS):
        inputs = {
            m.name: _rounded(
                random.uniform(*(ranges.get(m.name) or (-1.0, 1.0)), Type(m.axes).shape)
            )
            for m in problem.inputs.members
        }
        measured = {
            m.signal: _drawn(judge.expected(inputs)[m.signal], m.std, random)
            # drawn around what the filter expects: it stays where the model is
            for m in problem.measured
        }
        found, other = judge.correct(measured, inputs), single.correct(measured, inputs)
        values = judge.vector.copy(), _std(judge)
        rough = single.vector.astype(float), _std(single)
        after, again = judge.predict(inputs), single.predict(inputs)
        # from here on the two go apart for no fault of either
        if (found.status, after) != (other.status, again):
            break  # rounding decides whether it diverges
        steps.append(
            GoldenStep(
                measured=_flat(measured[m.signal] for m in problem.measured),
                given=_flat(inputs[m.name] for m in problem.inputs.members),
                corrected=int(found.status),
                predicted=int(after),
                x=tuple(values[0].tolist()),
                std=tuple(values[1].tolist()),
            )
        )
        moved.append((np.abs(rough[0] - values[0]), np.abs(rough[1] - values[1])))
    epsilon = float(np.finfo(dtype).eps)
    by_epsilon = epsilon / float(np.finfo(np.float32).eps)

    size = judge.numbers.size

    def largest(values: list[Array]) -> Array:
        return np.max(values, axis=0) if values else np.zeros(size)

    sizes = [largest([np.abs(step.x) for step in steps]), largest([np.array(s.std) for s in steps])]
    near = [
        # what single precision moves, scaled to the type, and a floor of some epsilons
        tuple((_ROUNDED * by_epsilon * largest(off) + _LEAST * epsilon * magnitude).tolist())
        for off, magnitude in zip(
            ([pair[0] for pair in moved], [pair[1] for pair in moved]), sizes, strict=True
        )
    ]
    return GoldenSteps(
        start=tuple(start.tolist()),
        steps=tuple(steps),
        near=near[0],
        near_std=near[1],
        largest=tuple(sizes[0].tolist()),
        largest_std=tuple(sizes[1].tolist()),
    )


def _start(judge: KalmanFilter, random: np.random.Generator) -> Array:
    """The spec's first estimate, else one within ranges."""
    found: list[Array] = []
    for state in judge.problem.program.states:
        member = judge.numbers.member(state.name)
        part = slice(member.first, member.first + member.size)
        drawn = random.uniform(*_range(state.range), member.size)
        # known starts stay; what nobody says is drawn
        found.append(np.where(judge.is_known[part], judge.vector[part], drawn))
    return _rounded(np.concatenate([*found, np.empty(0)]))


def _range(known: tuple[float, float] | None) -> tuple[float, float]:
    return known or (-1.0, 1.0)


def _named(judge: KalmanFilter, start: Array) -> dict[str, Array]:
    known = judge.problem.states.members
    return {m.name: start[m.first : m.first + m.size].reshape(Type(m.axes).shape) for m in known}


def _drawn(expected: Array, std: float, random: np.random.Generator) -> Array:
    noisy = expected + std * random.standard_normal(expected.shape)
    missing = random.uniform(size=expected.shape) < _MISSING
    return _rounded(np.where(missing | ~np.isfinite(noisy), np.nan, noisy))


def _std(judge: KalmanFilter) -> Array:
    return np.sqrt(np.maximum(np.diagonal(judge.covariance).astype(float), 0.0))


# numbers of single precision are the same in both
def _rounded(values: Array) -> Array:
    """Numbers that both precisions have."""
    return np.asarray(values, np.float32).astype(float)


def _flat(values: Iterable[Array]) -> tuple[float, ...]:
    return tuple(float(x) for value in values for x in np.ravel(value))
