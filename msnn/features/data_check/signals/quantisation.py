"""Measures the quantisation step of a series."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray

FEW_LEVELS = 16
"""A signal with so few values is switched between them, not quantised."""
_OFF_GRID = 0.1
"""Maximum distance from the grid, relative to the step, due to printing."""
_ROUNDING = 1e-9
"""Relative distance below which values are equal; unit conversions round them."""


@dataclass(frozen=True, slots=True)
class Quantisation:
    """The quantisation step of a series, and its effect."""

    step: float
    levels: int
    """Number of distinct values."""
    bits: float
    """log₂ of the number of steps in its span, i.e. the resolution of an instrument with that
    span.
    """
    share: float
    """Standard deviation of the rounding error, step/√12, relative to that of the series."""


def quantisation(values: FloatArray) -> Quantisation | None:
    """The step of the grid that contains all values; None without a grid or for a constant."""
    known = values[np.isfinite(values)]
    levels = np.unique(known)
    deviation = float(np.std(known)) if len(levels) > 1 else 0.0
    if deviation == 0:  # the least numbers have no squares
        return None
    span = float(levels[-1] - levels[0])
    steps = np.diff(levels)
    # conversions of units put equal values apart by a rounding
    steps = steps[steps > _ROUNDING * span]
    # each step as a multiple of the smallest: rounded values lie on a grid
    multiples = np.rint(steps / np.min(steps))
    total = float(np.sum(multiples))
    if total > 1 / _ROUNDING:
        return None
    # by the whole span: the error of the smallest step would add up
    step = span / total
    places = (levels - levels[0]) / step
    # one in a hundred may be off: interpolated by whoever recorded
    if np.mean(np.abs(places - np.rint(places)) <= _OFF_GRID) < 0.99:
        return None
    return Quantisation(
        step=step,
        levels=len(steps) + 1,
        bits=math.log2(total + 1),
        share=step / math.sqrt(12) / deviation,
    )


def rounding(values: FloatArray) -> float | None:
    """The quantisation step of a measured series; None for a switched or held one.

    Such a series is a command, whose values are exact even with few digits.
    """
    found = quantisation(values)
    if found is None or found.levels <= FEW_LEVELS:
        return None
    # a command is held for several rows: most differences are 0
    known = values[np.isfinite(values)]
    return None if np.median(np.abs(np.diff(known))) == 0 else found.step
