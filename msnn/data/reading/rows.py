"""Picks the rows of a file that make a record, and finds the gaps in its time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.reading.time_bounds import time_bound
from msnn.errors.data import rows as errors
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.expressions.moments import Moment
from spec_schema.expressions.tree import Samples
from spec_schema.sections.data.data import Layout

GAP_TOLERANCE = 0.01
"""Part of the sample time by which a time step may be off (rule R10)."""


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
    """A place where the time of a record is not what it should be."""

    kind: Literal["gap", "sample time", "order"]
    row: int
    """Row of the file."""
    step: float
    """Seconds: of the step before the row, or the usual step where that is another one."""
    more: int
    is_even: bool = True
    """Whether all steps are alike."""


def picked_rows(
    layout: Layout,
    defaults: Layout,
    file: str,
    rows: int,
    time: FloatArray | None,
    begins: Moment | None,
    findings: Findings,
) -> RowRange | None:
    """The rows that `from`, `to` and `every` leave of a file; None after a report.

    `begins` is time 0 where times are dates.
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
            # so that of both ends `stop` is exclusive afterwards
            bounds[index] = length.count + index
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
            findings.report(
                errors.time_not_increasing(file, *_disorder(time), None, is_picked=True)
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
    """The first row whose time is not later than before, that step, and how many rows more."""
    steps = np.diff(time)
    wrong = ~(steps > 0)
    row = int(np.argmax(wrong))
    return row + 1, float(steps[row]), int(wrong.sum()) - 1


def continuity(
    time: FloatArray, picked: RowRange, sample_time: float
) -> tuple[BoolArray, list[TimeFault]]:
    """The mask of picked rows one sample after the one before, and the faults elsewhere.

    The first row continues nothing. `time` holds the picked rows only.
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
