"""Measures the regularity of a file's sampling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import BoolArray, FileRows, FloatArray, TimeUnit

LONGEST_STEP = 1.5
"""A step above this multiple of the usual one is a gap."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepsOfTime:
    """Statistics of the time steps of one file, in seconds and rows."""

    file: str
    rows: int
    every: int
    """The spec uses one of this many rows."""
    time_unit: TimeUnit | None
    step: float
    """The median step; NaN with fewer than two times."""
    mean: float
    jitter: float
    """Standard deviation of the steps without gaps, relative to the median."""
    worst: float
    """The largest deviation of a step without gaps, relative to the median."""
    worst_row: int
    gaps: tuple[int, ...]
    """Rows directly after a gap."""
    lost: int
    """Rows that would fill the gaps at the median step."""
    longest: float
    """Seconds of the longest gap."""
    longest_row: int
    repeated: tuple[int, ...]
    """Rows with the time of the previous row."""
    backward: tuple[int, ...]
    """Rows earlier than the previous row."""


def sampling_of(piece: FileRows) -> StepsOfTime | None:
    """The sampling of a file; None without times."""
    if piece.time is None:
        return None
    time = piece.time
    steps = np.diff(time)
    rows = piece.file_rows(piece.start, piece.stop)
    forward = steps[steps > 0]
    # of steps forward alone: repeated and backward rows are faults of their own
    usual = float(np.median(forward)) if len(forward) else np.nan
    gaps = steps > LONGEST_STEP * usual
    # jitter is of steps that are no gaps
    even = (steps > 0) & ~gaps
    off = np.abs(steps - usual)
    worst = int(np.argmax(np.where(even, off, -1.0))) if even.any() else 0
    longest = int(np.argmax(np.where(gaps, steps, -1.0))) if gaps.any() else 0
    return StepsOfTime(
        file=piece.file,
        rows=len(time),
        every=piece.rows.step if isinstance(piece.rows, range) else 1,
        time_unit=piece.time_unit,
        step=usual,
        mean=float(np.mean(forward)) if len(forward) else np.nan,
        jitter=float(np.std(steps[even]) / usual) if even.any() else 0.0,
        worst=float(off[worst] / usual) if even.any() else 0.0,
        worst_row=int(rows[worst + 1]) if even.any() else 0,
        gaps=_rows(rows, gaps),
        lost=int(np.sum(np.rint(steps[gaps] / usual) - 1)) if gaps.any() else 0,
        longest=float(steps[longest]) if gaps.any() else 0.0,
        longest_row=int(rows[longest + 1]) if gaps.any() else 0,
        repeated=_rows(rows, steps == 0),
        backward=_rows(rows, steps < 0),
    )


def follows(time: FloatArray | None, rows: int) -> BoolArray:
    """Mask of rows about one usual step after the previous row, tolerant to jitter."""
    found = np.ones(rows, dtype=np.bool_)
    found[:1] = False
    if time is None or rows < 2:
        return found
    steps = np.diff(time)
    forward = steps[steps > 0]
    # without a step forward no row follows any
    usual = float(np.median(forward)) if len(forward) else np.inf
    found[1:] = (steps > 0) & (steps <= LONGEST_STEP * usual)
    return found


def _rows(rows: np.ndarray, wrong: BoolArray) -> tuple[int, ...]:
    return tuple(int(row) for row in rows[1:][wrong])
