"""Determines if values near a bound are optimal there or if training got stuck.

The derivative of the total decides (Karush, Kuhn, Tucker): at an optimum on a bound, descent points
outward. If it points inward, the value is not a minimum. This happens after too long a step, where
the sigmoid of the bounds is flat.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from compiler.ir.program import Parameter
from msnn.data.dataset import BoolArray, FloatArray

NEAR_BOUND = 1e-3
"""Fraction of the range, or of the distance to a bound, within which a value is near the bound."""

_STEEP = 1e-2
"""Cosine between residuals and their derivative above which a value is not a minimum."""
_GAIN = 1e-4
"""Minimum relative change of the total by a significant derivative, if the curvature is unknown."""


@dataclass(frozen=True, slots=True)
class BesideBounds:
    """The elements of parameters that are at a bound, and those that got stuck near one."""

    held: Mapping[str, BoolArray]
    stuck: Mapping[str, BoolArray]


def near_bounds(parameter: Parameter, value: FloatArray) -> tuple[BoolArray, BoolArray]:
    """The masks of elements near the minimum and near the maximum."""
    low, high = parameter.minimum, parameter.maximum
    # with one bound there is no range: the parameter's scale is what a change is measured by
    span = high - low if low is not None and high is not None else abs(parameter.scale)
    near_low = np.zeros(value.shape, dtype=np.bool_)
    near_high = near_low.copy()
    if low is not None:
        near_low = value - low < NEAR_BOUND * way_to(parameter, value, low, span)
        near_low |= value <= low
    if high is not None:
        near_high = high - value < NEAR_BOUND * way_to(parameter, value, high, span)
        near_high |= value >= high
    return near_low, near_high


def is_near_bound(parameter: Parameter, value: FloatArray) -> BoolArray:
    """The mask of elements near a bound of the parameter."""
    near_low, near_high = near_bounds(parameter, value)
    return near_low | near_high


def way_to(parameter: Parameter, value: FloatArray, bound: float, span: float) -> FloatArray:
    """The reference length for the distance to a bound; small values need a small one.

    It is the range or scale, or, if smaller, the larger of |bound| and the initial distance.
    """
    begun = np.asarray(parameter.initial)
    if begun.size != value.size:
        return np.full(value.shape, span)
    way = np.maximum(np.abs(begun.reshape(value.shape) - bound), abs(bound))
    return np.where(way > 0, np.minimum(way, span), span)


def beside_bounds(
    parameters: Sequence[Parameter],
    weights: Mapping[str, FloatArray],
    slope: FloatArray,
    curvature: FloatArray,
    total: float,
) -> BesideBounds:
    """Finds parameters that are at a bound and those that got stuck near one, by derivatives.

    F is the total loss at `weights`. `slope` (elements,) is half its gradient, `curvature`
    (elements,) the diagonal of JᵀJ. A value near a bound is held by it if the minimum along this
    single element is at or beyond the bound. It is stuck if that minimum is farther inside than the
    value and the loss decreases noticeably on the way.
    """
    held: dict[str, BoolArray] = {}
    stuck: dict[str, BoolArray] = {}
    begin = 0
    for parameter in parameters:
        value = weights[parameter.name]
        part = slice(begin, begin := begin + value.size)
        bent = curvature[part].reshape(value.shape)
        move = -slope[part].reshape(value.shape) / np.where(bent > 0.0, bent, np.inf)
        steep = move * move * bent > _STEEP**2 * total
        near_low, near_high = near_bounds(parameter, value)
        low = -np.inf if parameter.minimum is None else parameter.minimum
        high = np.inf if parameter.maximum is None else parameter.maximum
        held[parameter.name] = (near_low & (value + move <= low)) | (
            near_high & (value + move >= high)
        )
        stuck[parameter.name] = steep & (
            (near_low & (move > value - low)) | (near_high & (-move > high - value))
        )
    return BesideBounds(held, stuck)


def beside_bounds_by_slope(
    parameters: Sequence[Parameter],
    weights: Mapping[str, FloatArray],
    slope: Mapping[str, FloatArray],
    total: float,
) -> BesideBounds:
    """The same from the gradient alone, `slope` by parameter, if the curvature is unknown.

    A derivative is significant if a move over the near-bound distance changes the total by 10⁻⁴ of
    it.
    """
    held: dict[str, BoolArray] = {}
    stuck: dict[str, BoolArray] = {}
    for parameter in parameters:
        value, name = weights[parameter.name], parameter.name
        low, high = parameter.minimum, parameter.maximum
        span = high - low if low is not None and high is not None else abs(parameter.scale)
        near_low, near_high = near_bounds(parameter, value)
        held[name], stuck[name] = np.zeros_like(near_low), np.zeros_like(near_low)
        for near, bound, outward in ((near_low, low, 1.0), (near_high, high, -1.0)):
            if bound is None:
                continue
            gain = outward * slope[name].reshape(value.shape)
            gain = gain * NEAR_BOUND * way_to(parameter, value, bound, span)
            stuck[name] |= near & (gain < -_GAIN * abs(total))
            held[name] |= near & (gain > np.where(value == bound, 0.0, _GAIN * abs(total)))
    return BesideBounds(held, stuck)
