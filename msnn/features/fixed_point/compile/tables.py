"""Bounds the difference of a function's values for arguments that are close to each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msnn.features.fixed_point.integers.builder import CannotFitError
from msnn.features.fixed_point.integers.program import IntegerLookup, Width

Slope = Callable[[float, float], float]
"""The largest |f′| between two arguments; infinite if it is unbounded."""


def furthest(function: str, low: float, high: float, apart: float) -> float:
    """The largest |f(x) − f(y)| for |x − y| ≤ apart and x in low … high; inf if unknown. `function`
    is the name of f, such as `sin` or `1/x`.

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
    """The largest |f′| in low … high of the function with this name; inf if it is infinite or
    unknown.
    """
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


Reals = NDArray[np.float64]
_MOST_CELLS = {"q15": 512, "q31": 4096}
_TOLERANCE = {"q15": 2.0**-10, "q31": 2.0**-19}
"""Maximum interpolation error, relative to the span of the function's values."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedTable:
    """A table of a function, the fraction digits of its values and the integer range low … high of
    arguments that it covers.
    """

    table: IntegerLookup
    fraction: int
    low: int
    high: int
    error: float
    """Maximum difference between table and function, for any word after limiting to low … high."""


def fitted_table(
    name: str,
    function: Callable[[Any], Any],
    width: Width,
    argument: tuple[int, int, int],
) -> FittedTable:
    """The smallest table for a function that is accurate enough; `argument` is (low, high, fraction
    digits) of its integer argument, `name` is that of the function.

    A table ends where the function is constant within half a unit; the caller limits the argument
    to low … high. Raises CannotFitError if no table is accurate enough.
    """
    low, high, fraction = argument
    # every word where there are at most 65,537, else as many of them evenly spread
    points = np.unique(np.round(np.linspace(low, high, 2**16 + 1)))
    with np.errstate(all="ignore"):
        values = np.asarray(function(np.ldexp(points, -fraction)), np.float64)
    if not np.isfinite(values).all():
        raise CannotFitError("is not finite for every argument that can occur")
    reach = max(float(np.abs(values).max()), math.ldexp(1.0, -width.sum))
    scale = width.word - 1 - math.frexp(reach)[1]
    unit = math.ldexp(1.0, -scale)
    # a table cannot be closer than its own words
    tolerance = max(_TOLERANCE[width.name] * float(np.ptp(values)), 2 * unit)
    low, high = _varying(points, values, min(unit / 2, tolerance / 4), low, high)
    every, exact = points, values
    points, values = (
        points[(points >= low) & (points <= high)],
        values[(points >= low) & (points <= high)],
    )
    # widest cells first: the first table that is close enough is the smallest; a cell narrower than
    # the words keeps every product of interpolation within a sum
    for bits in range(min((high - low).bit_length(), width.word - 1), -1, -1):
        # cells begin at multiples of their width, so that a shift finds the cell of a word
        first = (low >> bits) << bits
        cells = ((high - first) >> bits) + 1
        if cells > _MOST_CELLS[width.name]:
            break
        nodes = _nodes(function, first, bits, cells, fraction, (low, high))
        if nodes is None:
            continue
        limit = width.largest_word
        whole = np.clip(np.round(np.ldexp(nodes, scale)), -limit, limit)
        places = first + 2.0**bits * np.arange(cells + 1)
        error = np.interp(points, places, np.ldexp(whole, -scale)) - values
        if float(np.abs(error).max()) <= tolerance:
            entries = tuple(int(value) for value in whole)
            table = np.interp(np.clip(every, low, high), places, np.ldexp(whole, -scale))
            # the interpolation is rounded to half a unit
            off = float(np.abs(table - exact).max()) + unit / 2
            steep = math.ldexp(float(np.abs(np.diff(whole)).max()), fraction - bits - scale)
            off += _between(name, every, fraction, steep)
            return FittedTable(
                table=IntegerLookup(first, bits, entries, name),
                fraction=scale,
                low=low,
                high=high,
                error=off,
            )
    raise CannotFitError(f"needs a table of more than {_MOST_CELLS[width.name]} cells")


def _between(name: str, points: Reals, fraction: int, steep: float) -> float:
    """Additional error of a table for words between the checked `points`; 0 if every word was
    checked.

    Bounded by the largest derivatives of function and table (`steep`) over the distance to the
    nearest point.
    """
    farthest = float(np.diff(points).max(initial=1.0)) // 2
    if farthest < 1:
        return 0.0
    ends = (math.ldexp(float(end), -fraction) for end in (points[0], points[-1]))
    return math.ldexp(farthest, -fraction) * (steep + steepest(name, *ends))


def _varying(
    points: Reals, values: Reals, negligible: float, low: int, high: int
) -> tuple[int, int]:
    """The part of the domain outside which the function equals its end values, within `negligible`.
    `values` are those at the integer `points` of low … high.
    """
    moved = np.flatnonzero(np.abs(values - values[0]) > negligible)
    if moved.size == 0:
        return low, low
    begin = int(points[max(moved[0] - 1, 0)])
    still = np.flatnonzero(np.abs(values - values[-1]) > negligible)
    return begin, int(points[min(still[-1] + 1, len(points) - 1)])


def _nodes(
    function: Callable[[Any], Any],
    first: int,
    bits: int,
    cells: int,
    fraction: int,
    domain: tuple[int, int],
) -> Reals | None:
    """The values of a table with `cells` cells of 2^bits from `first`: function values at the cell
    ends, shifted by half the interpolation error in the middle of the cells.

    None if a value is not finite.
    """
    places = first + 2.0**bits * np.arange(cells + 1)
    middles = places[:-1] + 2.0 ** (bits - 1)
    with np.errstate(all="ignore"):
        nodes, between = (
            np.asarray(function(np.ldexp(np.clip(x, *domain), -fraction)), np.float64)
            for x in (places, middles)
        )
    if not (np.isfinite(nodes).all() and np.isfinite(between).all()):
        return None
    # beyond the domain the last chord goes on, so that the cell is right inside
    for index, inner, edge in ((0, 1, domain[0]), (-1, -2, domain[1])):
        if cells > 1 and places[index] != edge and places[inner] != edge:
            part = (places[inner] - places[index]) / (places[inner] - edge)
            nodes[index] = nodes[inner] + (nodes[index] - nodes[inner]) * part
    inside = (middles >= domain[0]) & (middles <= domain[1])
    error = np.where(inside, between - (nodes[:-1] + nodes[1:]) / 2, 0.0)
    shifts = np.concatenate([error[:1] / 2, (error[:-1] + error[1:]) / 4, error[-1:] / 2])
    return nodes + shifts
