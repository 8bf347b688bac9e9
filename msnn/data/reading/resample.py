"""Resamples rows and streams to the model's sample time, without interpolating over holes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.data.formats.table import ColumnKey
from msnn.data.reading.rows import GAP_TOLERANCE
from spec_schema.expressions.tree import Duration

Method = Literal["linear", "nearest"]
Samples = tuple[FloatArray, FloatArray]
"""Times in seconds, and values; NaN if nothing was measured."""

LONGEST_STEP = 2.5
"""By default, a step longer than this many sample times and this many usual steps is a hole.

One lost row makes a step of two, which jitter lengthens.
"""
LOST_STEP = 1.5
"""Empty cells within a step longer than this many usual steps are missing values."""

_SLACK = 1e-6
"""Tolerance between summed and printed times, as a fraction of the sample time."""


@dataclass(frozen=True, slots=True)
class Resampled:
    """Columns on one uniform grid; `covered` is false for times in a hole of a column."""

    time: FloatArray
    columns: dict[ColumnKey, FloatArray]
    covered: BoolArray
    moments: Mapping[ColumnKey, IntArray]
    """For each compared column: the grid index of each measured value, or −1."""
    measured: Mapping[ColumnKey, FloatArray]
    """For each scored column: its values at these grid points, NaN at all others."""
    offsets: Mapping[ColumnKey, float]
    """For each scored column: maximum seconds between such a value and its grid point."""
    lost: Mapping[ColumnKey, BoolArray]
    """For columns with missing values: mask of grid points that need them; these are not
    covered.
    """


def resample(
    columns: Mapping[ColumnKey, Samples],
    sample_time: float,
    method: Method,
    span: tuple[float, float] | None = None,
    beside: Collection[ColumnKey] = (),
    scored: Collection[ColumnKey] = (),
    compared: Collection[ColumnKey] = (),
    predicted: Collection[ColumnKey] = (),
    on_lines: Collection[ColumnKey] = (),
    gap: float | Duration | None = None,
) -> Resampled:
    """Resamples columns (seconds, values) to a common grid with step `sample_time`.

    The grid begins where all columns that are not `predicted` have begun. A predicted column also
    covers the grid points within half a sample time of its first and last value. It adds no grid
    points and does not shift the grid.

    `linear` interpolates linearly between the measured values of a column. `nearest` takes the
    nearest value, and the earlier of two equally near ones. `span` limits the grid, `gap` is the
    longest step that is no hole.

    Holes of columns that are only `scored` do not end an episode. Their measured values are
    assigned to the grid point within half a sample time. If no step between two values exceeds 1.5
    sample times, `linear` interpolates them at that point. `compared` columns are also read:
    `moments` maps measured values to grid points. Columns in `beside` are scored but do not
    determine which grid points exist. Those in `on_lines` are compared like a signal that is read.
    """
    scored = {key for key in scored if key not in beside}
    measured = {key: _measured(samples) for key, samples in columns.items()}
    # a column that is only scored begins with its rows, whether or not their cells are empty
    deciding = {
        key: columns[key][0] if key in scored or not len(time) else time
        for key, (time, _) in measured.items()
        if key not in beside
    }
    # a lone target decides itself: no other column says where the record has rows
    hole_makers = deciding.keys() - scored or deciding.keys()
    given = deciding.keys() - scored - set(predicted)
    # where all columns have begun and none has ended; without any that is given the rows decide
    begins = [float(deciding[key][0]) for key in given]
    low = max(begins or [float(columns[key][0][0]) for key in deciding])
    # a value that is compared belongs to the nearest row, which may be behind it
    high = min(
        float(time[-1]) + (0.5 * sample_time if given and key not in given else 0.0)
        for key, time in deciding.items()
    )
    if span is not None:
        low, high = max(low, span[0]), min(high, span[1])
    late = max((float(deciding[key][0]) for key in deciding.keys() - given), default=low)
    low += sample_time * max(0.0, np.ceil((late - low) / sample_time - 0.5 - _SLACK))
    # the last row is kept where jitter puts it a hair before its moment; at 1 % exactly too, so
    # that times written in ms have the rows of those in s
    steps = (high - low) / sample_time + GAP_TOLERANCE + _SLACK
    count = int(np.floor(steps)) + 1 if high >= low else 0
    # k · step, in place: adding steps up would gather rounding, and long logs have room for one
    # array
    grid = np.arange(count, dtype=np.float64)
    grid *= sample_time
    grid += low
    covered = np.ones(count, dtype=np.bool_)
    found: dict[ColumnKey, FloatArray] = {}
    moments: dict[ColumnKey, IntArray] = {}
    at_moments: dict[ColumnKey, FloatArray] = {}
    offsets: dict[ColumnKey, float] = {}
    lost: dict[ColumnKey, BoolArray] = {}
    for key, (time, values) in measured.items():
        # values that the user has not picked are not looked for
        picked = slice(None) if span is None else (time >= span[0]) & (time <= span[1])
        if key in scored or key in compared:
            moments[key] = _moments_of(grid, time[picked], sample_time)
        if not len(time):
            found[key] = np.full(count, np.nan)
            if key not in beside and key not in scored:
                # no row has a value to take
                covered[:], lost[key] = False, ~np.zeros_like(covered)
        elif key in scored:
            found[key] = _at(grid, time, values, method)
            marked = _marked(count, moments[key])
            own = (time[picked], values[picked])
            at_moments[key], offsets[key] = _as_measured(grid, marked, own, sample_time, method)
            # a line through a hole joins values that say nothing of what lies between
            alone = _in_holes(grid, time, sample_time, gap) | (grid < time[0]) | (grid > time[-1])
            found[key][alone] = np.nan
            alone &= marked
            found[key][alone] = _at(grid[alone], time, values, "nearest")
        else:
            found[key] = _at(grid, time, values, method)
        if key in beside and len(time):
            marked = _marked(count, _moments_of(grid, time, sample_time))
            if key in on_lines:
                found[key] = np.where(marked, found[key], np.nan)
            else:
                found[key], _ = _as_measured(grid, marked, (time, values), sample_time, method)
        elif key in hole_makers:
            covered &= ~_in_holes(grid, deciding[key], sample_time, gap)
            if key not in scored:
                wanting = _in_lost(grid, columns[key], sample_time)
                covered &= ~wanting
                lost |= {key: wanting} if wanting.any() else {}
    return Resampled(grid, found, covered, moments, at_moments, offsets, lost)


def lost_values(samples: Samples, sample_time: float) -> IntArray:
    """The rows at which a column lacks a value although it usually has one.

    Empty cells between the values of a slow column do not count, if successive values are at most a
    sample time or 1.5 usual steps apart. The same limit applies before the first value and after
    the last.
    """
    time, values = samples
    absent = np.flatnonzero(np.isnan(values))
    own = _measured(samples)[0]
    if not len(own) or not len(absent):
        return absent
    longest = max(sample_time, LOST_STEP * _usual_step(own)) * (1 + _SLACK)
    after = np.searchsorted(own, time[absent])
    before = np.where(after > 0, own[after - 1], time[0])
    behind = np.where(after < len(own), own[np.minimum(after, len(own) - 1)], time[-1])
    return absent[behind - before > longest]


def _measured(samples: Samples) -> Samples:
    time, values = samples
    there = ~np.isnan(values)
    return samples if there.all() else (time[there], values[there])


def _moments_of(grid: FloatArray, time: FloatArray, sample_time: float) -> IntArray:
    """The nearest grid index of each measured value; −1 if none is within half a sample time."""
    if not len(grid):
        return np.full(len(time), -1, np.int64)
    place = (time - grid[0]) / sample_time
    # of two equally near grid points the earlier; the first point has none before it
    index = np.ceil(place - 0.5 - _SLACK).astype(np.int64)
    index[(index == -1) & (place >= -0.5 - _SLACK)] = 0
    return np.where((index < 0) | (index >= len(grid)), -1, index)


def _marked(count: int, moments: IntArray) -> BoolArray:
    """Mask of the listed grid points."""
    marked = np.zeros(count, dtype=np.bool_)
    marked[moments[moments >= 0]] = True
    return marked


def _as_measured(
    grid: FloatArray, marked: BoolArray, samples: Samples, sample_time: float, method: Method
) -> tuple[FloatArray, float]:
    """The values at marked grid points, NaN elsewhere, and the maximum time difference in
    seconds.
    """
    time, values = samples
    found = np.full(len(grid), np.nan)
    rows = np.flatnonzero(marked)
    if not len(rows):
        return found, 0.0
    nearest = _nearest(grid[rows], time)
    found[rows] = values[nearest]
    if method == "linear":
        after = np.searchsorted(time, grid[rows])
        inside = (after > 0) & (after < len(time))
        steps = time[np.minimum(after, len(time) - 1)] - time[np.maximum(after - 1, 0)]
        # a line of a longer step joins values that other rows are compared with
        dense = inside & (steps <= LOST_STEP * sample_time * (1 + _SLACK))
        found[rows[dense]] = np.interp(grid[rows[dense]], time, values)
        rows, nearest = rows[~dense], nearest[~dense]
    return found, float(np.abs(grid[rows] - time[nearest]).max(initial=0.0))


def _at(grid: FloatArray, time: FloatArray, values: FloatArray, method: Method) -> FloatArray:
    match method:
        case "linear":
            return np.interp(grid, time, values)
        case "nearest":
            return values[_nearest(grid, time)]


def _nearest(grid: FloatArray, time: FloatArray) -> IntArray:
    """The index of the value nearest to each grid point."""
    if len(time) == 1:
        return np.zeros(len(grid), np.int64)
    after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    before = after - 1
    # of two equally near values the earlier: the later one was not yet known then
    # the grid is summed up and times are printed: rounding makes no difference between them
    later = (grid - time[before]) - (time[after] - grid)
    slack = _SLACK * (time[after] - time[before]) + 4 * np.spacing(np.abs(grid))
    return np.where(later <= slack, before, after)


def longest_step(
    time: FloatArray, sample_time: float, gap: float | Duration | None = None
) -> float:
    """The longest step in seconds between values of a column that is not a hole.

    `gap` is a multiple of the sample time and of the column's usual step, or a duration.
    """
    if isinstance(gap, Duration):
        return max(gap.seconds, LOST_STEP * _usual_step(time)) * (1 + _SLACK)
    # a slow column has no holes between all of its rows
    # printed times of equal steps differ in their last digits
    return (gap or LONGEST_STEP) * max(sample_time, _usual_step(time)) * (1 + _SLACK)


def _usual_step(time: FloatArray) -> float:
    return float(np.median(np.diff(time))) if len(time) > 1 else 0.0


def _in_holes(
    grid: FloatArray, time: FloatArray, sample_time: float, gap: float | Duration | None
) -> BoolArray:
    longest = longest_step(time, sample_time, gap)
    return _inside(grid, time, np.diff(time) > longest, sample_time)


def _in_lost(grid: FloatArray, samples: Samples, sample_time: float) -> BoolArray:
    """Mask of grid points between the neighbours of a column's missing values."""
    own = _measured(samples)[0]
    lost = np.searchsorted(own, samples[0][lost_values(samples, sample_time)]) - 1
    steps = np.zeros(max(len(own) - 1, 0), dtype=np.bool_)
    # what is lost before the first value and after the last is in no step
    steps[lost[(lost >= 0) & (lost < len(steps))]] = True
    return _inside(grid, own, steps, sample_time)


def _inside(grid: FloatArray, time: FloatArray, steps: BoolArray, sample_time: float) -> BoolArray:
    """Mask of grid points inside the chosen steps of `time`."""
    inside = np.zeros(len(grid), dtype=np.bool_)
    # rows at the ends of a step are data, whatever rounding and jitter have made of the grid
    slack = GAP_TOLERANCE * sample_time
    chosen = np.flatnonzero(steps)
    first = np.searchsorted(grid, time[chosen] + slack, side="right")
    stop = np.searchsorted(grid, time[chosen + 1] - slack, side="left")
    # chosen steps are few; two arrays of comparisons would be as long as the log for each
    for a, b in zip(first.tolist(), stop.tolist(), strict=True):
        inside[a:b] = True
    return inside
