"""Proximal steps for priors and penalties, separate from the gradients of the losses.

The terms are priors ŝ²/n · ((p − mean)/std)² of the physical value p, magnitudes λ · |r| and norms
of slices λ · √Σ r² of the raw variables r. ŝ² is the estimated variance of the n residuals, λ the
weight of a penalty. A gradient step of length ηᵢ on the losses ends at r̂; then follows

    argmin over r of Σ (rᵢ − r̂ᵢ)²/(2ηᵢ) + the terms at r,

the proximal step in the metric of the optimiser (Parikh, Boyd 2014; for adaptive steps Yun, Lozano,
Yang 2021). It is exact for any weight, and sets elements and slices to exactly 0. Its fixed points
are the stationary points of the total. templates/native/known.c has the same for kernels.
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
"""Maximum number of Newton steps for a norm; they converge monotonically and quadratically."""

LARGEST_MOVE = 1.0
"""Maximum change of a bounded value's raw variable per step, where a sigmoid is nearly linear."""

LEAST_STD = 1e-100
"""Minimum standard deviation; the square of a smaller one underflows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownTerms:
    """The priors and penalties of the elements of some parameters, one after the other. `mean` and
    `std` are those of the priors of physical values; λ is the weight of a penalty on raw values.
    """

    parameters: tuple[Parameter, ...]
    mean: FloatArray
    std: FloatArray
    """0 for elements without a prior."""
    magnitude: FloatArray
    """λ of each element."""
    slices: tuple[IntArray, ...]
    """The element indices of each slice."""
    norms: FloatArray
    """λ of each slice."""

    @property
    def is_empty(self) -> bool:
        return not (self.std.any() or self.magnitude.any() or self.norms.any())

    @property
    def has_corners(self) -> bool:
        """True if there are penalties, which have no derivative at 0."""
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
    """The priors of the parameters in `trained`, and the penalties on them. Penalties come from
    `losses`, with the weight of the loss in `weights`. Other parameters have elements without
    terms. Raises KeyError for a loss without weight.
    """
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
                # without `over` a penalty is the mean of magnitudes
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
    """The raw variables after the proximal step of the module's docstring. `raw` is r̂, and `steps`
    are the lengths η, 0 for fixed elements; both have one element per parameter element. `spread`
    is ŝ²/n: estimated variance of residuals divided by their number.
    """
    raw, steps = raw.copy(), steps.copy()
    if spread > 0:
        _to_priors(terms, raw, steps, spread)
    return _to_corners(terms, raw, steps)


def _to_priors(terms: KnownTerms, raw: FloatArray, steps: FloatArray, spread: float) -> None:
    """Moves the raw variables towards the priors by one Gauss-Newton step, in place. It is exact if
    the physical value is linear in the raw one. Also shortens `steps` for the step that follows.
    """
    known = (terms.std > 0) & (steps > 0)
    value, slope, bounded = of_raw(terms.parameters, raw)
    variance = terms.std[known] ** 2
    pull = 2.0 * spread * steps[known] * slope[known]
    width = variance + pull * slope[known]
    move = pull * (value[known] - terms.mean[known]) / width
    limit = np.where(bounded[known], LARGEST_MOVE, np.inf)
    raw[known] -= np.clip(move, -limit, limit)
    # the prior adds its curvature to 1/η: the following proximal step is shorter
    steps[known] *= variance / width


def _to_corners(terms: KnownTerms, raw: FloatArray, steps: FloatArray) -> FloatArray:
    limit = steps * terms.magnitude
    # soft thresholding, the proximal step of λ|r|
    raw = np.where(limit > 0, np.sign(raw) * np.maximum(np.abs(raw) - limit, 0.0), raw)
    for numbers, weight in zip(terms.slices, terms.norms, strict=True):
        reach = steps[numbers] * weight
        # slices with a fixed element do not change
        if (reach > 0).all():
            raw[numbers] = _shrunk(raw[numbers], reach)
    return raw


def _shrunk(values: FloatArray, reach: FloatArray) -> FloatArray:
    """The proximal step of a norm: z with z(1 + reach/‖z‖) = values, or 0 if there is none. `reach`
    is step length times λ. r = ‖z‖ is the root of Σ (values/(r + reach))² = 1. The inverse square
    root of the left side is concave, so Newton's method converges from below.
    """
    if np.sum((values / reach) ** 2) <= 1.0:
        return np.zeros_like(values)
    # below the root, as Σ (values/(r + reach))² ≥ (‖values‖/(r + largest reach))² = 1 there
    radius = max(float(np.sqrt(np.sum(values * values))) - float(reach.max()), 0.0)
    for _ in range(NEWTON_STEPS):
        parts = values / (radius + reach)
        # Newton's step for 1/√squares − 1, with derivative steep/squares^1.5
        squares = float(np.sum(parts * parts))
        steep = float(np.sum(parts * parts / (radius + reach)))
        following = radius + (np.sqrt(squares) - 1.0) * squares / steep
        if following <= radius:
            break
        radius = following
    return values * (radius / (radius + reach))


def corners(terms: KnownTerms, raw: FloatArray) -> float:
    """The value of all penalties at these raw variables, Σ λ · |raw| + Σ λ · ‖slice of raw‖. They
    have no derivative at 0.
    """
    norms = [np.sqrt(np.sum(raw[numbers] ** 2)) for numbers in terms.slices]
    return float(terms.magnitude @ np.abs(raw)) + float(terms.norms @ np.array(norms))


def deviations(terms: KnownTerms, raw: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(p − mean)/std for the physical value p of every element, 0 without a prior, and its
    derivative with respect to the raw variable.
    """
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
    """For raw variables, one after the other in the order of `parameters`: their physical values,
    the derivatives of these, and a mask that is True for elements with a bound.
    """
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
    """A mask: True for elements of `values` that are exactly 0 and have a penalty, which keeps them
    there.
    """
    held = terms.magnitude > 0
    for numbers in terms.slices:
        held[numbers] = True
    return held & (values == 0.0)
