"""Detects spikes: values that jump away from their neighbours and back."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray, IntArray

WIDEST = 3
"""Maximum width of a spike in rows."""
FALSE_ALARMS = 0.01
"""Maximum expected number of spikes in a recording of Gaussian noise."""
_AROUND = 8
"""Rows on each side of a spike whose variation is compared with it."""
_PER_DEVIATION = 1.4826
"""Standard deviation of Gaussian noise divided by the median of its magnitude."""


@dataclass(frozen=True, slots=True)
class Spikes:
    """The first row, height and width of each spike."""

    rows: IntArray
    heights: FloatArray
    widths: IntArray

    def __len__(self) -> int:
        return len(self.rows)


def without_spikes(values: FloatArray, found: Spikes) -> FloatArray:
    """The series with spikes replaced by linear interpolation."""
    values = values.copy()
    for row, width in zip(found.rows.tolist(), found.widths.tolist(), strict=True):
        before, after = values[row - 1], values[row + width]
        values[row : row + width] = np.linspace(before, after, width + 2)[1:-1]
    return values


def spikes(values: FloatArray, follows: BoolArray) -> Spikes:
    """The spikes of a series with at most three rows; `follows` marks rows without a gap before.

    A spike of w rows begins at i if the differences d[i] and d[i+w] are both large and opposite,
    and the signal returns to its value. The threshold is s·√(2 ln(N/0.01)) with the standard
    deviation s from the median of |d|: of N Gaussian differences, fewer than 0.01 exceed it (Q(k) ≤
    exp(−k²/2)/2). Where the signal varies more, the local variation decides. If there are equally
    large jumps without return, the signal has steps, and short steps are not spikes.
    """
    found: list[IntArray] = []
    differences = np.diff(values)
    # across a gap there is no difference
    differences[~follows[1:]] = np.nan
    magnitudes = np.abs(differences)
    known = magnitudes[np.isfinite(magnitudes)]
    scale = _scale(known)
    # a series that stands still has no spikes
    if scale == 0:
        return _NONE
    limit = scale * math.sqrt(2 * math.log(len(known) / FALSE_ALARMS))
    for width in range(1, min(WIDEST, len(differences) - 1) + 1):
        away, back = differences[:-width], differences[width:]
        smaller = np.minimum(np.abs(away), np.abs(back))
        # away and back: of opposite sign, and as large
        there = (smaller > limit) & (away * back < 0) & (np.abs(away + back) < 0.5 * smaller)
        # wider ones must come back to where they were, not only turn
        if width > 1:  # the rows between stay up
            returned = np.abs(values[width + 1 :] - values[: -width - 1])
            there &= returned < 0.5 * smaller
        found.append(np.flatnonzero(there) + 1)
    rows, widths = _apart(found)
    heights = magnitudes[rows - 1]
    local = _motion_around(magnitudes, rows)
    # where the signal moves anyway, a spike must stand out of that
    kept = heights > local * limit / scale
    rows, heights, widths = rows[kept], heights[kept], widths[kept]
    rare = _rare(heights, np.sort(known[known > limit]))
    return Spikes(rows[rare], heights[rare], widths[rare])


_NONE = Spikes(np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64))


def _scale(magnitudes: FloatArray) -> float:
    """The standard deviation of usual differences; without zeros if most are 0."""
    if not len(magnitudes):
        return 0.0
    usual = float(np.median(magnitudes))
    if usual == 0:
        moving = magnitudes[magnitudes > 0]
        usual = float(np.median(moving)) if len(moving) else 0.0
    return _PER_DEVIATION * usual


def _apart(found: list[IntArray]) -> tuple[IntArray, IntArray]:
    """First rows and widths; of overlapping spikes only the narrowest."""
    taken: dict[int, int] = {}
    for width, rows in enumerate(found, start=1):
        for row in rows.tolist():
            # a wide one that begins within a narrow one is the same
            if not any(row - k in taken for k in range(WIDEST + 1)) and row + width not in taken:
                taken[row] = width
    rows = sorted(taken)
    return np.array(rows, np.int64), np.array([taken[row] for row in rows], np.int64)


def _motion_around(magnitudes: FloatArray, rows: IntArray) -> FloatArray:
    """The standard deviation of the differences around each spike, without its own."""
    # beside the spike, not within it
    offsets = np.concatenate((np.arange(-_AROUND - 1, -1), np.arange(WIDEST, WIDEST + _AROUND)))
    places = rows[:, None] + offsets
    inside = (places >= 0) & (places < len(magnitudes))
    beside = np.where(inside, magnitudes[np.clip(places, 0, len(magnitudes) - 1)], np.nan)
    known = np.isfinite(beside).any(axis=1)
    found = np.zeros(len(rows))
    if known.any():
        found[known] = np.nanmedian(beside[known], axis=1)
    return _PER_DEVIATION * found


def _rare(heights: FloatArray, jumps: FloatArray) -> BoolArray:
    """Mask of spikes to which most jumps of at least half their height belong, two each."""
    own = np.sort(heights)
    as_high = len(own) - np.searchsorted(own, 0.5 * heights)
    jumping = len(jumps) - np.searchsorted(jumps, 0.5 * heights)
    # two jumps a spike, and twice as many are let pass: a square wave has jumps without spikes
    return 2 * 2 * as_high >= jumping
