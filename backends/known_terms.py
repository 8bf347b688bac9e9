"""Takes raw variables to what is known of them beside the slopes of the losses.

That are priors ŝ²/n · ((p − mean)/std)² of the physical value p, magnitudes λ · |raw| and norms of
slices λ · √Σ raw². A step of length ηᵢ along the slope of the losses ends at r̂; then comes

    argmin over r of Σ (rᵢ − r̂ᵢ)²/(2ηᵢ) + the terms at r,

the proximal step in the metric of the optimiser (Parikh, Boyd 2014; for adaptive steps Yun, Lozano,
Yang 2021). It is exact for any weight, ends with numbers and slices that are exactly 0, and rests
where the slope of everything together is 0. The kernels have the same in templates/native/known.c.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backends.raw_parameters import mapping_of, physical_slope, physical_value
from compiler.ir.program import Loss, Parameter

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NEWTON_STEPS = 30
"""More than the root of a norm ever takes: they come from below and double their digits."""

LARGEST_MOVE = 1.0
"""Of a bounded value's raw variable in one step: a sigmoid is straight no farther."""

LEAST_STD = 1e-100
"""Deviations below have squares that are no numbers any more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownTerms:
    """The priors and penalties of the numbers of some parameters, one after the other."""

    parameters: tuple[Parameter, ...]
    mean: FloatArray
    std: FloatArray
    """0 where there is no prior."""
    magnitude: FloatArray
    """λ of each number."""
    slices: tuple[IntArray, ...]
    """The numbers of each slice."""
    norms: FloatArray
    """λ of each slice."""

    @property
    def is_empty(self) -> bool:
        return not (self.std.any() or self.magnitude.any() or self.norms.any())

    @property
    def has_corners(self) -> bool:
        """Whether there are terms without a slope at 0."""
        return bool(self.magnitude.any() or self.norms.any())

    @property
    def has_priors(self) -> bool:
        return bool(self.std.any())


def known_terms(
    parameters: Sequence[Parameter],
    losses: Sequence[Loss],
    weights: Mapping[str, float],
    trained: Collection[str],
) -> KnownTerms:
    """The terms of the parameters that are trained; losses are penalties with their weights."""
    sizes = [int(np.prod([axis.size for axis in p.axes])) for p in parameters]
    ends = np.cumsum([0, *sizes])
    mean, std, magnitude = (np.zeros(int(ends[-1])) for _ in range(3))
    slices: list[IntArray] = []
    norms: list[float] = []
    for parameter, begin, end in zip(parameters, ends[:-1], ends[1:], strict=True):
        if parameter.name not in trained:
            continue
        if parameter.prior is not None:
            mean[begin:end] = parameter.prior.mean
            std[begin:end] = max(parameter.prior.std, LEAST_STD)
        numbers = np.arange(begin, end).reshape([axis.size for axis in parameter.axes])
        for loss in losses:
            penalty, weight = loss.penalty, weights[loss.name] * parameter.scale
            if penalty is None or penalty.parameter != parameter.name or not weight:
                continue
            if penalty.over is None:
                # without `over` a penalty is the mean of the magnitudes
                magnitude[begin:end] += weight / numbers.size
                continue
            axis = [each.name for each in parameter.axes].index(penalty.over)
            for one in np.moveaxis(numbers, axis, 0):
                slices.append(one.ravel())
                norms.append(weight)
    return KnownTerms(
        parameters=tuple(parameters),
        mean=mean,
        std=std,
        magnitude=magnitude,
        slices=tuple(slices),
        norms=np.array(norms),
    )


def approached(terms: KnownTerms, raw: FloatArray, steps: FloatArray, spread: float) -> FloatArray:
    """The raw variables after the proximal step from these, `spread` being ŝ²/n.

    `steps` are the lengths η, 0 of numbers that are held.
    """
    raw, steps = raw.copy(), steps.copy()
    if spread > 0:
        _to_priors(terms, raw, steps, spread)
    return _to_corners(terms, raw, steps)


def _to_priors(terms: KnownTerms, raw: FloatArray, steps: FloatArray, spread: float) -> None:
    """One step of Gauss and Newton, which is all where the value is a multiple of raw."""
    known = (terms.std > 0) & (steps > 0)
    value, slope, bounded = of_raw(terms.parameters, raw)
    variance = terms.std[known] ** 2
    pull = 2.0 * spread * steps[known] * slope[known]
    width = variance + pull * slope[known]
    move = pull * (value[known] - terms.mean[known]) / width
    limit = np.where(bounded[known], LARGEST_MOVE, np.inf)
    raw[known] -= np.clip(move, -limit, limit)
    # the prior adds its curvature to 1/η: the step that corners take after it is shorter
    steps[known] *= variance / width


def _to_corners(terms: KnownTerms, raw: FloatArray, steps: FloatArray) -> FloatArray:
    limit = steps * terms.magnitude
    # soft thresholding, the proximal step of λ|r|
    raw = np.where(limit > 0, np.sign(raw) * np.maximum(np.abs(raw) - limit, 0.0), raw)
    for numbers, weight in zip(terms.slices, terms.norms, strict=True):
        reach = steps[numbers] * weight
        # slices with a number that is held stay as they are
        if (reach > 0).all():
            raw[numbers] = _shrunk(raw[numbers], reach)
    return raw


def _shrunk(values: FloatArray, reach: FloatArray) -> FloatArray:
    """z with z(1 + reach/‖z‖) = values; 0 where there is none.

    r = ‖z‖ is the root of Σ (values/(r + reach))² = 1, whose inverse root is concave: the steps of
    Newton come to it from below.
    """
    if np.sum((values / reach) ** 2) <= 1.0:
        return np.zeros_like(values)
    # below the root, as Σ (values/(r + reach))² ≥ (‖values‖/(r + largest reach))² = 1 there
    radius = max(float(np.sqrt(np.sum(values * values))) - float(reach.max()), 0.0)
    for _ in range(NEWTON_STEPS):
        parts = values / (radius + reach)
        # Newton's step for 1/√squares − 1, whose slope is steep/squares^1.5
        squares = float(np.sum(parts * parts))
        steep = float(np.sum(parts * parts / (radius + reach)))
        following = radius + (np.sqrt(squares) - 1.0) * squares / steep
        if following <= radius:
            break
        radius = following
    return values * (radius / (radius + reach))


def corners(terms: KnownTerms, raw: FloatArray) -> float:
    """Σ of the magnitudes and norms with their λ."""
    norms = [np.sqrt(np.sum(raw[numbers] ** 2)) for numbers in terms.slices]
    return float(terms.magnitude @ np.abs(raw)) + float(terms.norms @ np.array(norms))


def deviations(terms: KnownTerms, raw: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(p − mean)/std of every number, 0 where there is no prior, and its slope in raw."""
    value, slope, _ = of_raw(terms.parameters, raw)
    known = terms.std > 0
    width = np.where(known, terms.std, 1.0)
    return (
        np.where(known, (value - terms.mean) / width, 0.0),
        np.where(known, slope / width, 0.0),
    )


def of_raw(
    parameters: Sequence[Parameter], raw: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Physical values, their slopes in the raw variables, and which of them have bounds."""
    sizes = [int(np.prod([axis.size for axis in p.axes])) for p in parameters]
    parts = np.split(raw, np.cumsum(sizes)[:-1])
    pairs = list(zip(parameters, parts, strict=True))
    bounded = [np.full(part.shape, mapping_of(p) != 0) for p, part in pairs]
    return (
        np.concatenate([np.zeros(0), *(physical_value(p, part) for p, part in pairs)]),
        np.concatenate([np.zeros(0), *(physical_slope(p, part) for p, part in pairs)]),
        np.concatenate([np.zeros(0, bool), *bounded]),
    )


def in_corners(terms: KnownTerms, values: FloatArray) -> NDArray[np.bool_]:
    """Marks the numbers that a penalty holds at exactly 0."""
    held = terms.magnitude > 0
    for numbers in terms.slices:
        held[numbers] = True
    return held & (values == 0.0)
