"""Physical parameters from the raw variables that an optimiser moves, and back.

Without bounds physical = scale·raw; between two bounds minimum + (maximum − minimum)·sigmoid(raw);
above one minimum + scale·softplus(raw); below one maximum − scale·softplus(−raw).
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from compiler.program import Parameter

FloatArray = NDArray[np.float64]

BOUND_MARGIN = 1e-6
"""Loaded values closer to a bound than this part of the range (or scale) are moved off it."""


def physical_value(parameter: Parameter, raw: Tensor) -> Tensor:
    """The physical value that a raw variable stands for; differentiable, same shape."""
    match parameter.minimum, parameter.maximum:
        case None, None:
            return raw * parameter.scale
        case float(low), None:
            return low + parameter.scale * _softplus(raw)
        case None, float(high):
            return high - parameter.scale * _softplus(-raw)
        case float(low), float(high):
            return low + (high - low) * torch.sigmoid(raw)
        case _:
            raise AssertionError("bounds are floats or None")


def raw_value(parameter: Parameter, physical: FloatArray) -> tuple[FloatArray, bool]:
    """The raw variable of a physical value, and whether it had to be moved off a bound."""
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
            return np.log(inside - low) - np.log(high - inside), moved
        case _:
            raise AssertionError("bounds are floats or None")


def _inside(parameter: Parameter, physical: FloatArray) -> FloatArray:
    low, high = parameter.minimum, parameter.maximum
    span = high - low if low is not None and high is not None else abs(parameter.scale)
    if low is not None:
        physical = np.maximum(physical, low + BOUND_MARGIN * span)
    if high is not None:
        physical = np.minimum(physical, high - BOUND_MARGIN * span)
    return physical


def _softplus(raw: Tensor) -> Tensor:
    return torch.logaddexp(raw, torch.zeros_like(raw))


def _inverse_softplus(value: FloatArray) -> FloatArray:
    # log(exp(v) − 1) without overflow for large v and without cancellation for small v
    return value + np.log(-np.expm1(-value))
