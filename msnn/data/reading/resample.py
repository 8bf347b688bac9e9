"""Brings rows and streams to the sample time of the model, without inventing data over holes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.formats.table import ColumnKey

Method = Literal["linear", "nearest"]

LONGEST_STEP = 2.0
"""A step longer than this many sample times, and than this many usual steps, is a hole."""


@dataclass(frozen=True, slots=True)
class Resampled:
    """Columns on one even grid; `covered` is false for moments that lie in a hole of a column."""

    time: FloatArray
    columns: dict[ColumnKey, FloatArray]
    covered: BoolArray


def resample(
    columns: Mapping[ColumnKey, tuple[FloatArray, FloatArray]],
    sample_time: float,
    method: Method,
    span: tuple[float, float] | None = None,
    beside: Collection[ColumnKey] = (),
) -> Resampled:
    """Columns (seconds, values) at the moments that all of them cover, `sample_time` apart.

    Those `beside` have no say in what is covered: they are missing where they have nothing.

    `linear` draws straight lines between neighbours, `nearest` takes the closest one, the earlier
    of two. A missing value makes the moments beside it missing. `span` limits the moments.
    """
    deciding = [time for key, (time, _) in columns.items() if key not in beside]
    # where all columns have begun and none has ended
    low = max(float(time[0]) for time in deciding)
    high = min(float(time[-1]) for time in deciding)
    if span is not None:
        low, high = max(low, span[0]), min(high, span[1])
    # the last row is kept where rounding puts it a hair before its moment
    count = int(np.floor((high - low) / sample_time + 1e-6)) + 1 if high >= low else 0
    # k · step, in place: adding steps up would gather rounding, and long logs have room for one
    # array
    grid = np.arange(count, dtype=np.float64)
    grid *= sample_time
    grid += low
    covered = np.ones(count, dtype=np.bool_)
    found: dict[ColumnKey, FloatArray] = {}
    for key, (time, values) in columns.items():
        found[key] = _at(grid, time, values, method)
        known = ~_in_holes(grid, time, sample_time)
        if key in beside:
            # np.interp repeats the first and last value outside: that is no measurement
            known &= (grid >= time[0]) & (grid <= time[-1] + 1e-6 * sample_time)
            found[key] = np.where(known, found[key], np.nan)
        else:
            covered &= known
    return Resampled(grid, found, covered)


def _at(grid: FloatArray, time: FloatArray, values: FloatArray, method: Method) -> FloatArray:
    match method:
        case "linear":
            return np.interp(grid, time, values)
        case "nearest":
            after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1) if len(time) > 1 else 0
            before = np.maximum(after - 1, 0)
            # of two alike far the earlier: the later one was not known at that moment
            earlier = grid - time[before] <= time[after] - grid
            return values[np.where(earlier, before, after)]


def _in_holes(grid: FloatArray, time: FloatArray, sample_time: float) -> BoolArray:
    steps = np.diff(time)
    if not len(steps):
        return np.zeros(len(grid), dtype=np.bool_)
    # a slow column has no holes between all of its rows
    longest = LONGEST_STEP * max(sample_time, float(np.median(steps)))
    inside = np.zeros(len(grid), dtype=np.bool_)
    # rows at the ends of a hole are data, whatever rounding has made of the grid
    slack = 1e-9 * max(abs(float(time[0])), abs(float(time[-1])), sample_time)
    holes = np.flatnonzero(steps > longest)
    first = np.searchsorted(grid, time[holes] + slack, side="right")
    stop = np.searchsorted(grid, time[holes + 1] - slack, side="left")
    # holes are few; two arrays of comparisons would be as long as the log for each
    for a, b in zip(first.tolist(), stop.tolist(), strict=True):
        inside[a:b] = True
    return inside
