"""Measures the smallest step of a series of values that an instrument has rounded."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray

FEW_LEVELS = 16
"""A signal of so few values is switched between them, whatever instrument read it."""
_OFF_GRID = 0.1
"""How far from a multiple of the step a value may be, as part of the step: as printing rounds."""
_ROUNDING = 1e-9
"""Values nearer than this part of the span are equal: conversions of units round them."""


@dataclass(frozen=True, slots=True)
class Quantisation:
    """The step between neighbouring values, and how the series uses it."""

    step: float
    levels: int
    """Values that the series takes."""
    bits: float
    """log₂ of the number of steps in its span, as of an instrument that spans just that."""
    share: float
    """Deviation of the rounding error, step/√12, as part of the deviation of the series."""


def quantisation(values: FloatArray) -> Quantisation | None:
    """The step of the grid that all values lie on; None where there is none, or one value only."""
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
    """The step to which a measured series is rounded; None for one that is switched or held.

    Such a series is a command: its values are what was commanded, however few digits they have.
    """
    found = quantisation(values)
    if found is None or found.levels <= FEW_LEVELS:
        return None
    # a command is held for several rows: most differences are 0
    known = values[np.isfinite(values)]
    return None if np.median(np.abs(np.diff(known))) == 0 else found.step
