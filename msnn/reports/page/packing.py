"""Packs numbers for the page: single precision in base64, thinned where there are too many."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np

from msnn.data.dataset import FloatArray

Plain = dict[str, Any]


def packed(values: FloatArray) -> Plain:
    """Little-endian float32 in base64; what single precision cannot hold is infinite there."""
    with np.errstate(over="ignore"):
        single = np.asarray(values, "<f4")
    return {"f32": base64.b64encode(single.tobytes()).decode("ascii")}


def thinned(values: FloatArray, block: int) -> Plain:
    """Lowest and highest of each block of values, in the order in which they come.

    The page draws two points for a block, so that no peak is lost. A block without numbers is NaN.
    """
    count = math.ceil(len(values) / block)
    filled = np.full(count * block, np.nan)
    filled[: len(values)] = values
    table = filled.reshape(count, block)
    known = ~np.isnan(table)
    low, high = np.where(known, table, np.inf), np.where(known, table, -np.inf)
    first: FloatArray = low.min(axis=1)
    second: FloatArray = high.max(axis=1)
    swapped = low.argmin(axis=1) > high.argmax(axis=1)
    begin = np.asarray(np.where(swapped, second, first), np.float64)
    end = np.asarray(np.where(swapped, first, second), np.float64)
    pairs: FloatArray = np.stack((begin, end), axis=1)
    pairs[~known.any(axis=1)] = np.nan
    return {**packed(pairs.ravel()), "every": block / 2}


def series(values: FloatArray, block: int) -> Plain:
    """All values, or two for each block of more than two."""
    return packed(values) if block <= 2 else thinned(values, block)


def finite(value: float | None) -> float | None:
    """JSON knows neither NaN nor infinity."""
    return None if value is None or not math.isfinite(value) else float(value)


def listed(values: FloatArray) -> list[float | None]:
    """Few values, as JSON has numbers."""
    return [finite(value) for value in np.asarray(values, np.float64).ravel().tolist()]
