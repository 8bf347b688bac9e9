"""Finds spikes: values that jump away from their neighbours and at once back again."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray, IntArray

WIDEST = 3
"""Rows of the widest spike."""
FALSE_ALARMS = 0.01
"""Spikes expected in a whole record of Gaussian noise that has none, at most."""
_AROUND = 8
"""Rows on either side of a spike whose motion is compared with it."""
_PER_DEVIATION = 1.4826
"""Standard deviation of Gaussian noise per median of its magnitude."""


@dataclass(frozen=True, slots=True)
class Spikes:
    """The first row of each spike and how far it is from where the signal came from."""

    rows: IntArray
    heights: FloatArray
    widths: IntArray

    def __len__(self) -> int:
        return len(self.rows)


def without_spikes(values: FloatArray, found: Spikes) -> FloatArray:
    """The series with straight lines in place of its spikes: they say nothing of the system."""
    values = values.copy()
    for row, width in zip(found.rows.tolist(), found.widths.tolist(), strict=True):
        before, after = values[row - 1], values[row + width]
        values[row : row + width] = np.linspace(before, after, width + 2)[1:-1]
    return values


def spikes(values: FloatArray, follows: BoolArray) -> Spikes:
    """The spikes of up to three rows of a series; `follows` says which rows continue another.

    A spike of w rows begins at i where d[i] and d[i+w] of the differences d are both large, point
    apart, and the signal is back where it was. Large is beyond s·√(2 ln(N/0.01)), where s is the
    deviation that the median of |d| says: of N Gaussian differences fewer than 0.01 lie beyond it
    (Q(k) ≤ exp(−k²/2)/2). Where the signal moves more than usual, the motion around decides. Jumps
    that are as large and do not come back make a signal of steps, in which short ones are no fault.
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
    """The deviation of usual differences; where most are 0, of those that are not."""
    if not len(magnitudes):
        return 0.0
    usual = float(np.median(magnitudes))
    if usual == 0:
        moving = magnitudes[magnitudes > 0]
        usual = float(np.median(moving)) if len(moving) else 0.0
    return _PER_DEVIATION * usual


def _apart(found: list[IntArray]) -> tuple[IntArray, IntArray]:
    """First rows and widths; of spikes that begin within each other only the narrowest."""
    taken: dict[int, int] = {}
    for width, rows in enumerate(found, start=1):
        for row in rows.tolist():
            # a wide one that begins within a narrow one is the same
            if not any(row - k in taken for k in range(WIDEST + 1)) and row + width not in taken:
                taken[row] = width
    rows = sorted(taken)
    return np.array(rows, np.int64), np.array([taken[row] for row in rows], np.int64)


def _motion_around(magnitudes: FloatArray, rows: IntArray) -> FloatArray:
    """The deviation of the differences beside each spike, without those of the spike itself."""
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
    """Whether jumps of at least half the height are mostly those of spikes, two each."""
    own = np.sort(heights)
    as_high = len(own) - np.searchsorted(own, 0.5 * heights)
    jumping = len(jumps) - np.searchsorted(jumps, 0.5 * heights)
    # two jumps a spike, and twice as many are let pass: a square wave has jumps without spikes
    return 2 * 2 * as_high >= jumping
