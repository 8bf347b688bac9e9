"""Draws the samples of a filter's self-test, and records the estimates of the filter in Python."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.c_language.literals import Dtype
from compiler.ir.types import Type
from msnn.features.control.backend.library import FilterLibrary, compiled_texts
from msnn.features.control.kalman_filter import KalmanFilter
from msnn.features.control.problem.state_estimation import EstimationProblem

STEPS = 24
_MISSING = 0.2
"""Fraction of measured elements that are NaN, not measured."""
_ROUNDED = 30.0
"""Safety factor on the rounding error that float32 causes in the Python filter.

The C differs more: it sums in another order, and stores the covariance as factors U and D.
"""
_LEAST = 64.0
"""Minimum tolerance, as a multiple of machine epsilon times the largest magnitude."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GoldenStep:
    """The measurements and inputs of a sample, and the estimate after the correction."""

    measured: tuple[float, ...]
    """All measured elements in the order of the measurements; NaN is not measured."""
    given: tuple[float, ...]
    """All inputs, at this sample."""
    corrected: int
    """Status of the correction."""
    predicted: int
    """Status of the prediction."""
    x: tuple[float, ...]
    std: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class GoldenSteps:
    """Successive steps, and the tolerances of the generated filter."""

    start: tuple[float, ...]
    """Argument of reset: the initial states."""
    steps: tuple[GoldenStep, ...]
    near: tuple[float, ...]
    """Absolute tolerance of each element of the estimate."""
    near_std: tuple[float, ...]
    """Absolute tolerance of each standard deviation."""
    largest: tuple[float, ...]
    """Largest magnitude of each element of the estimate along the steps."""
    largest_std: tuple[float, ...]
    """Largest standard deviation of each element along the steps."""


def golden_steps(
    problem: EstimationProblem, weights: Mapping[str, ArrayLike], dtype: Dtype, seed: int = 0
) -> GoldenSteps:
    """Runs the Python filter on random inputs and measurements, from a random initial state, and
    returns its estimates as golden steps.

    The random values are exact in float32 and float64. The tolerances follow from the difference
    between runs in float64 and float32, scaled to the machine epsilon of `dtype`. The run ends
    early if rounding changes a status.
    """
    reference = KalmanFilter(problem, weights)
    single = KalmanFilter(problem, weights, np.float32)
    random = np.random.default_rng(seed)
    start = _start(reference, random)
    ranges = {signal.name: signal.range for signal in problem.program.signals}
    # both start from the same values, exact in both precisions
    for each in (reference, single):
        each.reset(_named(reference, start))
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
            m.signal: _drawn(reference.expected(inputs)[m.signal], m.std, random)
            # drawn around the expected measurement, so that the estimate stays plausible
            for m in problem.measured
        }
        corrected, other = reference.correct(measured, inputs), single.correct(measured, inputs)
        values = reference.vector.copy(), _std(reference)
        rough = single.vector.astype(float), _std(single)
        after, again = reference.predict(inputs), single.predict(inputs)
        # different statuses: the runs are no longer comparable
        if (corrected.status, after) != (other.status, again):
            break  # rounding decides whether it diverges
        steps.append(
            GoldenStep(
                measured=_flat(measured[m.signal] for m in problem.measured),
                given=_flat(inputs[m.name] for m in problem.inputs.members),
                corrected=int(corrected.status),
                predicted=int(after),
                x=tuple(values[0].tolist()),
                std=tuple(values[1].tolist()),
            )
        )
        moved.append((np.abs(rough[0] - values[0]), np.abs(rough[1] - values[1])))
    epsilon = float(np.finfo(dtype).eps)
    by_epsilon = epsilon / float(np.finfo(np.float32).eps)

    size = reference.numbers.size

    def largest(values: list[Array]) -> Array:
        return np.max(values, axis=0) if values else np.zeros(size)

    sizes = [largest([np.abs(step.x) for step in steps]), largest([np.array(s.std) for s in steps])]
    near = [
        # difference caused by float32, scaled to the type, plus a minimum of some epsilons
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


def _start(reference: KalmanFilter, random: np.random.Generator) -> Array:
    """Returns the initial states of the spec, flat; those without one are drawn within their
    ranges.
    """
    parts: list[Array] = []
    for state in reference.problem.program.states:
        member = reference.numbers.member(state.name)
        part = slice(member.first, member.first + member.size)
        drawn = random.uniform(*_range(state.range), member.size)
        # draws only states without an initial value
        parts.append(np.where(reference.is_known[part], reference.vector[part], drawn))
    return _rounded(np.concatenate([*parts, np.empty(0)]))


def _range(known: tuple[float, float] | None) -> tuple[float, float]:
    """Returns the range, or (−1, 1) for None."""
    return known or (-1.0, 1.0)


def _named(reference: KalmanFilter, start: Array) -> dict[str, Array]:
    """Splits a vector of states into arrays by name."""
    members = reference.problem.states.members
    return {m.name: start[m.first : m.first + m.size].reshape(Type(m.axes).shape) for m in members}


def _drawn(expected: Array, std: float, random: np.random.Generator) -> Array:
    """Returns a measurement with normal noise; some of its elements are NaN, not measured."""
    noisy = expected + std * random.standard_normal(expected.shape)
    missing = random.uniform(size=expected.shape) < _MISSING
    return _rounded(np.where(missing | ~np.isfinite(noisy), np.nan, noisy))


def _std(reference: KalmanFilter) -> Array:
    """Returns the standard deviation of each element of the estimate."""
    return np.sqrt(np.maximum(np.diagonal(reference.covariance).astype(float), 0.0))


def _rounded(values: Array) -> Array:
    """Rounds to float32; such values are exact in float64, too."""
    return np.asarray(values, np.float32).astype(float)


def _flat(values: Iterable[Array]) -> tuple[float, ...]:
    """Concatenates the elements of all arrays in C order."""
    return tuple(float(x) for value in values for x in np.ravel(value))


def recorded_bits(golden: GoldenSteps, texts: Mapping[str, str], name: str) -> int | None:
    """Returns a 32-bit hash of the bits of all estimates and standard deviations that the compiled
    filter computes for the golden steps.

    `texts` are its files by path, `name` is its prefix. The hash is FNV-1a over 32-bit words with
    an added shift. None without a working C compiler.
    """
    built = compiled_texts(texts)
    if built is None:
        return None
    library = FilterLibrary(json.loads(texts[f"{name}.json"]), built)
    library.reset(golden.start)
    # FNV-1a over words moves bits upwards only: the added shift moves high bits down
    hashed = 2166136261
    for step in golden.steps:
        estimate = library.correct_numbers(step.measured, step.given)
        library.predict_numbers(step.given)
        for values in (estimate.x, estimate.std):
            for word in values.view(np.uint32).tolist():
                hashed = ((hashed ^ word) * 16777619) & 0xFFFFFFFF
                hashed ^= hashed >> 15
    return hashed
