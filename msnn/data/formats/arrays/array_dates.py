"""Reads an array of dates: numpy's datetime64, texts, or objects whose text is a date."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msnn.data.dataset import FloatArray
from msnn.data.formats.written_units import MISSING
from msnn.errors.data import cells as cell_errors
from msnn.errors.data import units as data_units
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.expressions.moments import FARTHEST, Moment, read_moment

_MISSING = MISSING | {"nat", "none", "<na>"}
_PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
"""Ticks per second of datetime64; coarser units are read as seconds, finer ones as nanoseconds."""


@dataclass(frozen=True, slots=True)
class Dates:
    """Seconds since the first date, the first date, and diagnostics for invalid dates."""

    seconds: FloatArray
    begins: Moment | None
    faults: tuple[Diagnostic, ...] = ()


def has_dates(array: NDArray[Any]) -> bool:
    """True for a datetime64 array, or if the first element is the text of a date."""
    if array.ndim != 1:
        return False
    if array.dtype.kind == "M":
        return True
    return array.dtype.kind in "OUT" and len(array) > 0 and read_moment(str(array[0])) is not None


def dates_of(array: NDArray[Any], file: str, column: str, *, is_utc: bool) -> Dates:
    """The dates of an array for which `has_dates` is true; `is_utc` gives datetime64 a time zone.

    Other objects are parsed from their text, such as a pandas Timestamp with its UTC offset.
    """
    if array.dtype.kind == "M":
        return _of_numpy(array, file, column, is_utc=is_utc)
    moments = [read_moment(str(cell)) for cell in array]
    first = moments[0]
    assert first is not None, "has_dates has seen it"
    no_dates = [row for row, moment in enumerate(moments) if moment is None]
    absent = [row for row in no_dates if str(array[row]).lower() in _MISSING]
    # markers for missing values and invalid dates are reported separately: the repairs differ
    others = [row for row in no_dates if row not in set(absent)]
    of_another_clock = [
        row
        for row, moment in enumerate(moments)
        if moment is not None and moment.has_zone != first.has_zone
    ]
    faults = tuple(
        make(file, rows[0], column, str(array[rows[0]]), len(rows) - 1, None)
        for make, rows in (
            (partial(cell_errors.missing_value, is_time=True), absent),
            (data_units.not_a_moment, others),
            (data_units.mixed_zones, of_another_clock),
        )
        if rows
    )
    seconds = np.array(
        [np.nan if moment is None else moment.nanoseconds - first.nanoseconds for moment in moments]
    )
    return Dates(seconds / 1e9, first, faults)


def _of_numpy(array: NDArray[Any], file: str, column: str, *, is_utc: bool) -> Dates:
    absent = np.isnat(array)
    faults: tuple[Diagnostic, ...] = ()
    if absent.any():
        row, more = int(np.argmax(absent)), int(absent.sum()) - 1
        faults = (cell_errors.missing_value(file, row, column, "NaT", more, None, is_time=True),)
    if absent.all():
        return Dates(np.full(len(array), np.nan), None, faults)
    unit, count = np.datetime_data(array.dtype)
    # `datetime64[10ms]` counts in tens; astype() brings it to single ticks
    if unit not in _PER_SECOND or count != 1:
        # seconds reach farther than any date, and nanoseconds farther than what is finer
        unit = "ns" if unit in ("ps", "fs", "as") else "s" if unit not in _PER_SECOND else unit
        array = array.astype(f"datetime64[{unit}]")
    ticks, length = array.astype(np.int64), 10**9 // _PER_SECOND[unit]
    # before anything is multiplied: int64 nanoseconds overflow without a word
    far = ~absent & ((ticks <= -FARTHEST // length) | (ticks >= FARTHEST // length))
    if far.any():
        row, more = int(np.argmax(far)), int(far.sum()) - 1
        wild = data_units.too_far_a_moment(file, row, column, str(array[row]), more)
        return Dates(np.full(len(array), np.nan), None, (*faults, wild))
    first = int(ticks[~absent][0])
    # subtracted as integers, so that the quotient is exact to the last digit that a log has
    seconds = np.where(absent, np.nan, (ticks - first) / _PER_SECOND[unit])
    return Dates(seconds, Moment(first * length, is_utc), faults)
