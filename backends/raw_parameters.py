"""Maps unconstrained raw variables of an optimiser to bounded physical values and back.

Without bounds physical = scale·raw; between two bounds minimum + (maximum − minimum)·sigmoid(raw);
above one minimum + scale·softplus(raw); below one maximum − scale·softplus(−raw). Between two
bounds and for raw > 0 the formula is maximum − (maximum − minimum)·sigmoid(−raw). A nonnegative
value is then subtracted from the maximum, so that rounding cannot exceed it (decision 0400).
"""

from __future__ import annotations

import math
from enum import IntEnum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from compiler.ir.program import Parameter
from compiler.kernels.table import evaluate

FloatArray = NDArray[np.float64]

BOUND_MARGIN = 1e-6
"""Loaded values closer to a bound than this fraction of the range (or scale) are moved off it."""

_STRAIGHT = 40.0
"""From this argument on softplus(x) = x: exp(−40) is below its rounding error."""


class Mapping(IntEnum):
    """The formula from raw to physical values, by the bounds of a parameter; the numbers are those
    in training kernels.
    """

    LINEAR = 0
    BETWEEN = 1
    ABOVE = 2
    BELOW = 3


def mapping_of(parameter: Parameter) -> Mapping:
    """The formula from raw to physical values that the parameter's bounds require."""
    match parameter.minimum is not None, parameter.maximum is not None:
        case True, True:
            return Mapping.BETWEEN
        case True, False:
            return Mapping.ABOVE
        case False, True:
            return Mapping.BELOW
        case _:
            return Mapping.LINEAR


def raw_value(parameter: Parameter, physical: FloatArray) -> tuple[FloatArray, bool]:
    """The raw variable of a physical value, in the same shape, and True if an element was so close
    to a bound that it had to be moved off it.
    """
    inside = _inside(parameter, physical)
    moved = bool(np.any(inside != physical))
    match parameter.minimum, parameter.maximum:
        case None, None:
            return inside / parameter.scale, moved
        case float(low), None:
            return _inverse_softplus((inside - low) / parameter.scale), moved
        case None, float(high):
            return -_inverse_softplus((high - inside) / parameter.scale), moved
        case float(low), float(high):
            return _log(inside - low) - _log(high - inside), moved
        case _:
            raise AssertionError("bounds are floats or None")


def is_off_bounds(parameter: Parameter, physical: FloatArray) -> NDArray[np.bool_]:
    """A mask: True for elements of a physical value that are not moved off a bound, so that
    training starts at exactly this value.
    """
    return _inside(parameter, physical) == physical


def physical_value(parameter: Parameter, raw: FloatArray) -> FloatArray:
    """The physical value of a raw variable, in the same shape, by the parameter's bounds and
    scale.
    """
    match parameter.minimum, parameter.maximum:
        case None, None:
            return raw * parameter.scale
        case float(low), None:
            return low + parameter.scale * _softplus(raw)
        case None, float(high):
            return high - parameter.scale * _softplus(-raw)
        case float(low), float(high):
            share = (high - low) * _sigmoid(-np.abs(raw))
            return np.where(raw > 0.0, high - share, low + share)
        case _:
            raise AssertionError("bounds are floats or None")


def physical_slope(parameter: Parameter, raw: FloatArray) -> FloatArray:
    """The derivative ∂(physical value)/∂(raw variable) at a raw variable, in the same shape."""
    match parameter.minimum, parameter.maximum:
        case None, None:
            return np.full_like(raw, parameter.scale)
        case float(), None:
            return parameter.scale * _sigmoid(raw)
        case None, float():
            return parameter.scale * _sigmoid(-raw)
        case float(low), float(high):
            # not σ (1 − σ), which cancels where σ is nearly 1
            return (high - low) * _sigmoid(raw) * _sigmoid(-raw)
        case _:
            raise AssertionError("bounds are floats or None")


def _inside(parameter: Parameter, physical: FloatArray) -> FloatArray:
    low, high = parameter.minimum, parameter.maximum
    span = high - low if low is not None and high is not None else abs(parameter.scale)
    # for a narrow range the margin is lost by rounding: then the next float is used
    if low is not None:
        inner = max(low + BOUND_MARGIN * span, math.nextafter(low, math.inf))
        physical = np.maximum(physical, inner)
    if high is not None:
        inner = min(high - BOUND_MARGIN * span, math.nextafter(high, -math.inf))
        physical = np.minimum(physical, inner)
    return physical


def _inverse_softplus(value: FloatArray) -> FloatArray:
    # log(exp(v) − 1) = v/2 + log(2 sinh(v/2)), without overflow for large v, where it is v, and
    # without cancellation for small v
    half = np.minimum(value, _STRAIGHT) / 2
    return np.where(value < _STRAIGHT, half + _log(2.0 * _kernel("sinh", half)), value)


def _log(value: FloatArray) -> FloatArray:
    return _kernel("log", value)


def _softplus(raw: FloatArray) -> FloatArray:
    return _kernel("softplus", raw)


def _sigmoid(raw: FloatArray) -> FloatArray:
    return _kernel("sigmoid", raw)


def _kernel(name: str, value: FloatArray) -> FloatArray:
    """A scalar function by the project's own math kernel, element by element, since numpy's
    functions have other bits on other processors.
    """
    value = np.asarray(value, np.float64)
    if value.size == 1:  # initial values, which every training stage requests again
        return np.full(value.shape, _of_number(name, value.tobytes()))
    return evaluate(name, value)


@lru_cache(1024)
def _of_number(name: str, bits: bytes) -> float:
    """A scalar function of one float64, given as its eight bytes, so that the cache tells 0.0 from
    -0.0.
    """
    return float(evaluate(name, np.frombuffer(bits))[0])
