"""Packs numbers for the page: base64 of float32, thinned if there are too many."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np

from msnn.data.dataset import FloatArray

Plain = dict[str, Any]

_FAR = 2.0
"""Minimum distance from 0, in multiples of their range, for storing values as differences."""


def packed(values: FloatArray) -> Plain:
    """A JSON object with the values as base64 of little-endian float32; values beyond single
    precision become infinite.

    Values that are close together and far from 0, such as times since 1970, are stored as
    differences from `base`, so that single precision suffices.
    """
    # float32 has 24 bits: seconds since 1970 would be known to two minutes
    base = _base(values)
    with np.errstate(over="ignore"):
        single = np.asarray(values - base, "<f4")
    text = base64.b64encode(single.tobytes()).decode("ascii")
    return {"f32": text, "base": base} if base else {"f32": text}


def rounding(values: FloatArray) -> float:
    """A bound on the rounding error of the finite values in `packed`, in their unit."""
    known = values[np.isfinite(values)] - _base(values)
    # half a unit in the last place of the largest, by round to nearest even
    return float(np.abs(known).max(initial=0.0)) * 2.0**-24


def _base(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0
    low, high = float(known.min()), float(known.max())
    # low + high may overflow where the middle does not
    middle = low + (high - low) / 2
    return middle if abs(middle) > _FAR * (high - low) else 0.0


def thinned(values: FloatArray, block: int) -> Plain:
    """Minimum and maximum of each block of `block` values, packed, in the order in which they
    occur.

    The page draws two points per block, so that no peak is lost. A block without numbers is NaN.
    `every` is the number of samples per point.
    """
    count = math.ceil(len(values) / block)
    # the last block is filled up with what is not drawn
    filled = np.full(count * block, np.nan)
    filled[: len(values)] = values
    table = filled.reshape(count, block)
    known = ~np.isnan(table)
    low, high = np.where(known, table, np.inf), np.where(known, table, -np.inf)
    first: FloatArray = low.min(axis=1)
    second: FloatArray = high.max(axis=1)
    # drawn as they come: a rise is not shown as a fall
    swapped = low.argmin(axis=1) > high.argmax(axis=1)
    begin = np.asarray(np.where(swapped, second, first), np.float64)
    end = np.asarray(np.where(swapped, first, second), np.float64)
    pairs: FloatArray = np.stack((begin, end), axis=1)
    pairs[~known.any(axis=1)] = np.nan
    # two points stand for `block` samples
    return {**packed(pairs.ravel()), "every": block / 2}


def series(values: FloatArray, block: int) -> Plain:
    """The values in packed form: all of them for `block` ≤ 2, else two per block of
    `block` values.
    """
    return packed(values) if block <= 2 else thinned(values, block)


def finite(value: float | None) -> float | None:
    """The value; NaN and infinity become None for JSON."""
    return None if value is None or not math.isfinite(value) else float(value)


def listed(values: FloatArray) -> list[float | None]:
    """The values as a flat list of JSON numbers; NaN and infinity become None. For short arrays."""
    return [finite(value) for value in np.asarray(values, np.float64).ravel().tolist()]
