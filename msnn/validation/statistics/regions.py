"""Tells where in the range of its inputs a model errs, and where it was never trained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray

_PARTS = 4
_MARGIN = 1e-9
"""Part of the range by which a value may leave it by rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """A quarter of the scored samples, by the value of an input when they were predicted."""

    low: float
    high: float
    rmse: float
    scored: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Extrapolation:
    """Scored samples whose input lies outside of what was trained on."""

    signal: str
    share: float
    """Of the scored samples, 0 to 1."""
    low: float
    """The range of the rows that were trained on."""
    high: float


def regions(squares: FloatArray, values: FloatArray) -> tuple[Region, ...]:
    """The rmse in each quarter of the values; fewer where values repeat, none where all are one.

    `squares` are mean squared errors of samples, `values` those of an input; NaN is left out.
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
    """The values that lie outside the range of those that were trained on; None where none does."""
    values, trained = values[np.isfinite(values)], trained[np.isfinite(trained)]
    if not len(values) or not len(trained):
        return None
    low, high = float(trained.min()), float(trained.max())
    # rounding at the ends of the range is no extrapolation
    margin = _MARGIN * (high - low)
    share = float(np.mean((values < low - margin) | (values > high + margin)))
    return Extrapolation(signal=signal, share=share, low=low, high=high) if share else None
