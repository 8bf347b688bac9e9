"""Finds input regions with large errors, and inputs outside the training range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray

_PARTS = 4
_MARGIN = 1e-9
"""Tolerance for leaving a range by rounding, relative to the range."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """A quarter of the scored samples, by the value of an input at the time of prediction."""

    low: float
    high: float
    rmse: float
    scored: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Extrapolation:
    """Scored samples whose input is outside the training range."""

    signal: str
    share: float
    """Fraction of the scored samples, 0 to 1."""
    low: float
    """The range of the training rows."""
    high: float


def regions(squares: FloatArray, values: FloatArray) -> tuple[Region, ...]:
    """The RMSE in each quarter of the values; fewer parts with repeated values.

    `squares` are mean squared errors of samples, `values` those of an input; NaN is ignored. Empty
    if all values are equal.
    """
    known = np.isfinite(squares) & np.isfinite(values)
    squares, values = squares[known], values[known]
    if not len(values):
        return ()
    # quarters of samples, not of the range: each holds as many
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _PARTS + 1)))
    if len(edges) < 2:
        return ()
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    found: list[Region] = []
    for number in range(len(edges) - 1):
        inside = place == number
        if inside.any():
            found.append(
                Region(
                    low=float(values[inside].min()),
                    high=float(values[inside].max()),
                    rmse=float(np.sqrt(squares[inside].mean())),
                    scored=int(inside.sum()),
                )
            )
    return tuple(found)


def extrapolation(signal: str, values: FloatArray, trained: FloatArray) -> Extrapolation | None:
    """The values outside the training range; None if there are none."""
    values, trained = values[np.isfinite(values)], trained[np.isfinite(trained)]
    if not len(values) or not len(trained):
        return None
    low, high = float(trained.min()), float(trained.max())
    # rounding at the ends of the range is no extrapolation
    margin = _MARGIN * (high - low)
    share = float(np.mean((values < low - margin) | (values > high + margin)))
    return Extrapolation(signal=signal, share=share, low=low, high=high) if share else None
