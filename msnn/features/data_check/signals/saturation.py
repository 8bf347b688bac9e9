"""Detects saturation: values that stay at their maximum or minimum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray

Side = Literal["largest", "smallest"]

SHORTEST = 3
"""Minimum number of rows at a limit."""
_FEW_LEVELS = 16
"""A signal with so few values is switched, not saturated."""
_NEAR = 0.02
"""Width of the comparison band below a limit, relative to the span."""
_CROWDED = 3.0
"""Minimum ratio of rows at the limit and in the comparison band.

A quantised sine is √2 + 1 = 2.41 times as often at its maximum as at the next value.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Saturation:
    """A limit at which a series stays."""

    side: Side
    value: float
    rows: int
    longest: int
    """Rows of the longest interval at the limit."""
    first: int
    """First row of the longest interval."""


def saturation(values: FloatArray, follows: BoolArray) -> tuple[Saturation, ...]:
    """The saturation limits of a series.

    A series must stay at the limit for three rows or more, longer than usual at other values;
    otherwise a staircase would be saturated. It must also be there much more often than at
    neighbouring values; otherwise the rounded top of a wave would be.
    """
    known = np.isfinite(values)
    if known.sum() < 2 * SHORTEST:
        return ()
    low, high = float(np.min(values[known])), float(np.max(values[known]))
    if low == high or _levels(values[known]) <= _FEW_LEVELS:
        return ()
    # stays: runs of equal values that follow each other
    begins = np.flatnonzero(np.concatenate(([True], (np.diff(values) != 0) | ~follows[1:])))
    lengths = np.diff(np.concatenate((begins, [len(values)])))
    at = values[begins]
    found: list[Saturation] = []
    near = _NEAR * (high - low)
    sides: tuple[tuple[Side, float, BoolArray], ...] = (
        ("largest", high, (values < high) & (values >= high - near)),
        ("smallest", low, (values > low) & (values <= low + near)),
    )
    for side, value, band in sides:
        stays, others = at == value, np.isfinite(at) & (at != low) & (at != high)
        longest = int(lengths[stays].max())
        rows = int(lengths[stays].sum())
        # by rows, not by stays: how long the stay is in which a row is found
        usual = float(np.sum(lengths[others] ** 2) / np.sum(lengths[others]))
        # what is beside the limit in value: a wave that is cut jumps over it
        beside = max(int(band.sum()), _next_level(values[known], value))
        if longest >= SHORTEST and longest > 3 * usual and rows > _CROWDED * beside:
            first = int(begins[stays][np.argmax(lengths[stays])])
            found.append(
                Saturation(side=side, value=value, rows=rows, longest=longest, first=first)
            )
    return tuple(found)


def _levels(values: FloatArray) -> int:
    """The number of distinct values; counting stops if there are clearly many."""
    # a look at the first rows: sorting all would take the time of reading
    few = np.unique(values[: 64 * _FEW_LEVELS])
    return len(few) if len(few) > _FEW_LEVELS else len(np.unique(values))


def _next_level(values: FloatArray, limit: float) -> int:
    """Number of rows at the value nearest to the limit."""
    others = values[values != limit]
    nearest = others[np.argmin(np.abs(others - limit))]
    return int(np.sum(values == nearest))
