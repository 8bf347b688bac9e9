"""Selects the rows of a file that form a recording, between times or dates, and finds gaps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.errors.data import cells as data_units
from msnn.errors.data import rows as errors
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.expressions.moments import Date, Moment
from spec_schema.expressions.tree import Duration, Samples
from spec_schema.sections.data import Layout

GAP_TOLERANCE = 0.01
"""Tolerance of time steps, as a fraction of the sample time (rule R10)."""


@dataclass(frozen=True, slots=True)
class RowRange:
    """Rows `first`, `first + every`, … below `stop` of a file."""

    first: int
    stop: int
    every: int

    @property
    def rows(self) -> slice:
        return slice(self.first, self.stop, self.every)


@dataclass(frozen=True, slots=True)
class TimeFault:
    """An error in the times of a recording."""

    kind: Literal["gap", "sample time", "order"]
    row: int
    """Row of the file."""
    step: float
    """Seconds: the step before the row, or the usual step if it is not the sample time."""
    more: int
    is_even: bool = True
    """True if all steps are equal."""


def picked_rows(
    layout: Layout,
    defaults: Layout,
    file: str,
    rows: int,
    time: FloatArray | None,
    begins: Moment | None,
    counted: IntArray | None,
    findings: Findings,
) -> RowRange | None:
    """The rows of a file selected by `from`, `to` and `every`; None after reporting errors.

    `begins` is time 0 if times are dates. `counted` are the numbers that `from` and `to` have for
    the rows, if these are not 0, 1, 2, …
    """
    first_length = layout.first or defaults.first
    last_length = layout.last or defaults.last
    every = layout.every or defaults.every or 1
    bounds = [0, rows]
    for index, (key, length) in enumerate((("from", first_length), ("to", last_length))):
        if length is None:
            continue
        if isinstance(length, Samples):
            # `to: n` includes row n
            # so `stop` is exclusive in either case
            bounds[index] = length.count + index
            if counted is not None:
                bounds[index] = int(np.searchsorted(counted, bounds[index]))
            continue
        if time is None:
            findings.report(errors.no_time_column(f"`{key}`", length.span))
            return None
        bound = time_bound(f"`{key}`", length, begins, file, findings)
        if bound is None:
            return None
        later = time <= bound.seconds + bound.slack if index else time < bound.seconds - bound.slack
        # time rises: the rows before the bound are as many as are earlier
        bounds[index] = int(np.sum(later))
        if not later[: bounds[index]].all():  # of a clock that was set back, they are no range
            row, step, more = _disorder(time)
            is_local = begins is not None and not begins.has_zone
            findings.report(
                errors.time_not_increasing(
                    file,
                    row,
                    step,
                    more,
                    None,
                    set_back=is_local and -3600.0 <= step <= -1800.0,
                    is_picked=True,
                )
            )
            return None
    first, stop = max(bounds[0], 0), min(bounds[1], rows)
    if first >= stop:
        span = next(length.span for length in (first_length, last_length) if length is not None)
        ends = None
        if time is not None and len(time) and not isinstance(first_length or last_length, Samples):
            ends = (float(time[0]), float(time[-1]))
        times = None
        if ends is not None and begins is not None:
            times = (begins.text_after(ends[0]), begins.text_after(ends[1]))
        elif ends is not None:
            times = (f"{ends[0]:.6g} s", f"{ends[1]:.6g} s")
        findings.report(errors.rows_not_there("the choice of rows", file, rows, span, times))
        return None
    return RowRange(first, stop, every)


def _disorder(time: FloatArray) -> tuple[int, float, int]:
    """The first row that is not later than the previous one, its step, and the count of further
    ones.
    """
    steps = np.diff(time)
    wrong = ~(steps > 0)
    row = int(np.argmax(wrong))
    return row + 1, float(steps[row]), int(wrong.sum()) - 1


def continuity(
    time: FloatArray, picked: RowRange, sample_time: float
) -> tuple[BoolArray, list[TimeFault]]:
    """Mask of rows one sample after the previous row, and the faults in the other steps.

    The first row is False. `time` has the selected rows only.
    """
    steps = np.diff(time)
    good = np.abs(steps - sample_time) <= GAP_TOLERANCE * sample_time
    continues = np.concatenate((np.zeros(min(len(time), 1), dtype=np.bool_), good))
    faults: list[TimeFault] = []

    def fault(kind: Literal["gap", "order"], wrong: BoolArray) -> None:
        index = int(np.argmax(wrong))
        row = picked.first + (index + 1) * picked.every
        faults.append(TimeFault(kind, row, float(steps[index]), int(wrong.sum()) - 1))

    # not `steps <= 0`, which is false for NaN
    backward = ~(steps > 0)
    if backward.any():
        fault("order", backward)
    elif not good.all():
        # most steps agree with the spec: single gaps; else the sample time itself is another
        common = float(np.median(steps))
        if np.abs(common - sample_time) <= GAP_TOLERANCE * sample_time:
            fault("gap", ~good)
        else:
            row = picked.first + (int(np.argmin(good)) + 1) * picked.every
            is_even = bool((np.abs(steps - common) <= GAP_TOLERANCE * common).all())
            more = int(np.sum(~good)) - 1
            faults.append(TimeFault("sample time", row, common, more, is_even))
    return continues, faults


@dataclass(frozen=True, slots=True)
class TimeBound:
    """A time in seconds, and the tolerance within which a row is at that time."""

    seconds: float
    slack: float


def bound_of_seconds(seconds: float) -> TimeBound:
    """The bound at a time, tolerant to rounding: 59.99999 and 60 mean the same row."""
    return TimeBound(seconds, 1e-6 * max(abs(seconds), 1.0))


def time_bound(
    what: str, wanted: Duration | Date, begins: Moment | None, file: str, findings: Findings
) -> TimeBound | None:
    """The bound in a recording whose time 0 is `begins`; None if its times are not dates.

    Returns None after reporting a date that cannot be compared with the recording's times.
    """
    match wanted:
        case Duration():
            return bound_of_seconds(wanted.seconds)
        case Date():
            # a date with a zone and one without cannot be compared: nobody knows the logger's zone
            if begins is None or begins.has_zone != wanted.moment.has_zone:
                zone = None if begins is None else begins.has_zone
                findings.report(
                    data_units.misfitting_date(what, wanted.text, file, zone, wanted.span)
                )
                return None
            # dates are exact; in float64, seconds of three years are rounded to 15 ns
            return TimeBound(wanted.moment.seconds_from(begins), 1e-7)
