"""Bounds the difference of a function's values for arguments that are close to each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

Slope = Callable[[float, float], float]
"""The largest |f′| between two arguments; infinite if it is unbounded."""


def furthest(function: str, low: float, high: float, apart: float) -> float:
    """The largest |f(x) − f(y)| for |x − y| ≤ apart and x in low … high; inf if unknown.

    By the mean value theorem with the largest |f′| in the widened interval. √, asin and acos have
    their own bounds at the ends of their domains, where |f′| is infinite.
    """
    if apart == 0.0:
        return 0.0
    if not math.isfinite(apart):
        return math.inf
    # y may lie outside low … high, by `apart` at most
    by_slope = apart * steepest(function, low - apart, high + apart)
    match function:
        case "sqrt":  # (√x − √y)² ≤ |x − y|
            return min(by_slope, math.sqrt(apart))
        case "asin" | "acos":  # steepest at the ends, where acos(1 − d) is the change
            return min(by_slope, math.acos(max(1.0 - apart, -1.0)))
        case _:
            return by_slope


def steepest(function: str, low: float, high: float) -> float:
    """The largest |f′| in low … high; inf if it is infinite or unknown."""
    slope = _SLOPES.get(function)
    if slope is None:
        return math.inf
    try:
        return slope(low, high)
    except OverflowError:
        return math.inf


def _nearest(low: float, high: float) -> float:
    """The distance between 0 and the closest point of the interval."""
    return 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))


def _farthest(low: float, high: float) -> float:
    return max(abs(low), abs(high))


def _sigmoid(x: float) -> float:
    # further below, exp(−x) comes near the largest float64; σ(−700) is about 1e-304
    return 1.0 / (1.0 + math.exp(-x)) if x > -700.0 else 0.0


def _of_root(square: float) -> float:
    return 1.0 / math.sqrt(square) if square > 0.0 else math.inf


_SLOPES: Mapping[str, Slope] = {
    "1/x": lambda low, high: _nearest(low, high) ** -2 if _nearest(low, high) > 0.0 else math.inf,
    "exp": lambda low, high: math.exp(high),
    "log": lambda low, high: 1.0 / low if low > 0.0 else math.inf,
    "sqrt": lambda low, high: 0.5 * _of_root(low),
    "sin": lambda low, high: 1.0,
    "cos": lambda low, high: 1.0,
    # the branch around 0 alone: the poles are at ±π/2
    "tan": lambda low, high: (
        1.0 / math.cos(_farthest(low, high)) ** 2
        if _farthest(low, high) < 0.5 * math.pi
        else math.inf
    ),
    "asin": lambda low, high: _of_root(1.0 - _farthest(low, high) ** 2),
    "acos": lambda low, high: _of_root(1.0 - _farthest(low, high) ** 2),
    "atan": lambda low, high: 1.0 / (1.0 + _nearest(low, high) ** 2),
    "sinh": lambda low, high: math.cosh(_farthest(low, high)),
    "cosh": lambda low, high: math.sinh(_farthest(low, high)),
    "tanh": lambda low, high: 1.0 - math.tanh(_nearest(low, high)) ** 2,
    "sigmoid": lambda low, high: _sigmoid(_nearest(low, high)) * _sigmoid(-_nearest(low, high)),
    "softplus": lambda low, high: _sigmoid(high),
}
"""Each |f′| is largest at an end, or at the argument nearest to or farthest from 0."""
