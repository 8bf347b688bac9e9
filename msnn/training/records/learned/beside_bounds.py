"""Decides for values near a bound whether the data hold them there or training got stuck there.

The derivative of the total says it (Karush, Kuhn, Tucker): on a bound that the data hold it points
outward. Where it points inward the value is no minimum, as after a step of an optimiser so long
that a sigmoid is flat there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from compiler.ir.program import Parameter
from msnn.data.dataset import BoolArray, FloatArray

NEAR_BOUND = 1e-3
"""Part of the range, or of the way to a bound, within which a value counts as near it."""

_STEEP = 1e-2
"""Cosine of residuals and their derivative above which a value is no minimum."""
_GAIN = 1e-4
"""Part of the total that a derivative must change, where the curvature is not known."""


@dataclass(frozen=True, slots=True)
class BesideBounds:
    """The elements of parameters that are at a bound, and those that got stuck near one."""

    held: Mapping[str, BoolArray]
    stuck: Mapping[str, BoolArray]


def near_bounds(parameter: Parameter, value: FloatArray) -> tuple[BoolArray, BoolArray]:
    """The masks of elements of a value that are near the minimum and near the maximum."""
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
    """The mask of elements of a value that are near a bound of the parameter."""
    near_low, near_high = near_bounds(parameter, value)
    return near_low | near_high


def way_to(parameter: Parameter, value: FloatArray, bound: float, span: float) -> FloatArray:
    """The measure of a distance to a bound, as small numbers are small beside any scale.

    The range or scale, or where that is less the bound, or how far it was to it at first.
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
    """From half the derivative of the total F and its curvature, of each number of parameters.

    `curvature` is the diagonal of JᵀJ. A value near a bound is held by it where the minimum along
    this one number is on or beyond it. It is stuck where that minimum is farther inside than the
    value itself, and the loss falls on the way.
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
    """From the derivative of the total alone, where its curvature is not known.

    A derivative is one if the way that counts as near the bound changes the total by 10⁻⁴ of it.
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
