"""Accumulates errors blockwise: by step of rollouts for the curve, by row for the trace."""

from __future__ import annotations

from math import prod

import numpy as np

from msnn.data.dataset import FloatArray, IntArray
from msnn.validation.measurement import ErrorCurve, ErrorTrace, bounds

_SAMPLES = 20
"""Approximate samples per point of the curve, if only few rollouts reach a step."""


class CurveSums:
    """Σe² by step within the rollout, from `begin` on.

    With `few` rollouts, `samples` is the total number of samples, and neighbouring steps share
    points.
    """

    def __init__(self, begin: int, steps: int, samples: int, *, few: bool) -> None:
        # few rollouts have no mean at each step that says anything: steps share points, some 20
        # samples each
        most = (max(samples // _SAMPLES, 1),) if few else ()
        self._steps = steps
        self._first = begin + bounds(steps - begin, *most)
        self._total = np.zeros(len(self._first))
        self._scored = np.zeros(len(self._first), np.int64)

    def add(self, prediction: FloatArray, target: FloatArray, number: IntArray) -> None:
        """Adds predictions with their step numbers."""
        squares, counts = _sums_of_squares(prediction, target)
        # where each step falls among the points, whose beginnings are sorted
        point = np.searchsorted(self._first, number, side="right") - 1
        # `bincount` sums by point in one pass; adding by index would keep one of several
        self._total += np.bincount(point, squares, len(self._first))
        self._scored += np.bincount(point, counts, len(self._first)).astype(np.int64)

    def curve(self) -> ErrorCurve | None:
        """The RMSE at each point; None for one-step rollouts, or if nothing was scored."""
        kept = self._scored > 0
        if self._steps <= 1 or not kept.any():
            return None
        # points without a target are left out of the curve
        last = np.append(self._first[1:], self._steps)
        rmse = np.sqrt(self._total[kept] / self._scored[kept])
        return ErrorCurve(self._first[kept] + 1, last[kept], rmse, self._scored[kept])


class RowErrors:
    """The error of each row of the data, from the first rollout that predicts it."""

    def __init__(self, rows: int, shape: tuple[int, ...]) -> None:
        self._errors = np.zeros((rows, *shape))
        self._seen = np.zeros(rows, np.bool_)

    def add(self, prediction: FloatArray, target: FloatArray, rows: IntArray) -> None:
        """Adds predictions with their rows, in the order of rollouts."""
        # rollouts that overlap predict a row several times: the first one counts
        new = np.flatnonzero(~self._seen[rows])
        # the first of those within this block
        found, first = np.unique(rows[new], return_index=True)
        with np.errstate(all="ignore"):  # a prediction that has left the numbers shows as such
            self._errors[found] = prediction[new[first]] - target[new[first]]
        self._seen[found] = True

    @property
    def rows(self) -> IntArray:
        """The predicted rows, in order."""
        return np.flatnonzero(self._seen)

    @property
    def errors(self) -> FloatArray:
        """The errors of these rows, (rows, *shape)."""
        return self._errors if self._seen.all() else self._errors[self._seen]


class ErrorRange:
    """The minimum and maximum finite error over elements, for each row of the data."""

    def __init__(self, rows: int) -> None:
        self._low, self._high = np.full(rows, np.inf), np.full(rows, -np.inf)
        self._samples = np.zeros(rows, np.int32)

    def add(self, prediction: FloatArray, target: FloatArray, rows: IntArray) -> None:
        """Adds predictions with their rows."""
        with np.errstate(all="ignore"):
            # NaN and ∞ of a prediction are seen in metrics; a picture needs a range
            error = (prediction - target).reshape(len(rows), prod(target.shape[1:]))
        finite = np.isfinite(error)
        there = finite.any(axis=1)
        rows, error, finite = rows[there], error[there], finite[there]
        # `minimum.at`, as a row may be there more than once
        np.minimum.at(self._low, rows, np.where(finite, error, np.inf).min(axis=1))
        np.maximum.at(self._high, rows, np.where(finite, error, -np.inf).max(axis=1))
        np.add.at(self._samples, rows, 1)

    def trace(self) -> ErrorTrace:
        """The range of errors at each point of the trace."""
        rows = np.flatnonzero(self._samples)
        if not len(rows):
            return ErrorTrace(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
        count = self._samples[rows].astype(np.int64)
        begin = np.cumsum(count) - count
        # points end where as many samples are in each, not as many rows
        point = np.searchsorted(bounds(int(count.sum())), begin, side="right")
        first = np.flatnonzero(np.diff(point, prepend=0))
        low = np.minimum.reduceat(self._low[rows], first)
        return ErrorTrace(begin[first], low, np.maximum.reduceat(self._high[rows], first))


def _sums_of_squares(prediction: FloatArray, target: FloatArray) -> tuple[FloatArray, IntArray]:
    """Σe² of each sample over its elements with a target, and their number."""
    # what was not measured is not scored (R9)
    there = ~np.isnan(target.reshape(len(target), prod(target.shape[1:])))
    with np.errstate(all="ignore"):  # a prediction that has left the numbers shows as such
        error = (prediction - target).reshape(there.shape)
        squares = np.where(there, error * error, 0.0)
    return squares.sum(axis=1), there.sum(axis=1)
