"""Measures an output that was simulated one way: every metric, and where it errs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray, IntArray
from msnn.validation.judged_errors import JudgedErrors
from msnn.validation.metrics import Scores, score
from spec_schema.sections.validation import Metric
from spec_schema.units.unit import Unit

METRICS: tuple[Metric, ...] = ("rmse", "mae", "max_abs", "fit", "r2", "fvu", "aic")
_POINTS = 200
"""The most points of a curve; more steps or samples than that share points."""
_SAMPLES = 20
"""About as many samples share a point where only few rollouts reach a step."""


@dataclass(frozen=True, slots=True)
class ErrorCurve:
    """The error of the k-th prediction of all rollouts, which grows where a model feeds on itself.

    Point i is the rmse over k = first[i] … last[i], counted from 1: one k a point in rollouts of up
    to 200 steps, several in longer ones and in those over whole records, of which there are few.
    Points without a target are left out.
    """

    first: IntArray
    last: IntArray
    rmse: FloatArray
    scored: IntArray


@dataclass(frozen=True, slots=True)
class ErrorTrace:
    """The range of prediction − target along the scored samples, in order of rows."""

    sample: IntArray
    """The first sample of each point."""
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """One output against its target: the same rollouts, every metric."""

    of: str
    unit: Unit | None
    """Of the output; that of rmse, mae, max_abs and both curves."""
    horizon: str
    closed: tuple[str, ...]
    data: str
    rows: str
    scored: int
    metrics: Mapping[Metric, Scores]
    curve: ErrorCurve | None
    """None where every rollout is one step."""
    trace: ErrorTrace
    judged: JudgedErrors
    """What the errors tell of the model."""


def scores_of(prediction: FloatArray, target: FloatArray, parameters: int) -> dict[Metric, Scores]:
    """Every metric of the same (samples, *shape) arrays."""
    return {metric: score(metric, prediction, target, parameters) for metric in METRICS}


def error_curve(
    prediction: FloatArray, target: FloatArray, number: IntArray, *, few: bool
) -> ErrorCurve | None:
    """The rmse by `number`, that of the prediction within its rollout, from 0.

    Where there are `few` rollouts, neighbouring steps share points.
    """
    steps = int(number.max(initial=0)) + 1
    if steps == 1:
        return None
    begin = int(number.min())
    first = begin + _bounds(steps - begin, max(len(number) // _SAMPLES, 1) if few else _POINTS)
    squares, counts = _sums_of_squares(prediction, target)
    point = np.searchsorted(first, number, side="right") - 1
    total = np.bincount(point, squares, len(first))
    scored = np.bincount(point, counts, len(first)).astype(np.int64)
    kept = scored > 0
    if not kept.any():
        return None
    last = np.append(first[1:], steps)
    rmse = np.sqrt(total[kept] / scored[kept])
    return ErrorCurve(first[kept] + 1, last[kept], rmse, scored[kept])


def error_trace(prediction: FloatArray, target: FloatArray) -> ErrorTrace:
    """The smallest and the largest finite error of any element around each sample."""
    error = (prediction - target).reshape(len(prediction), -1)
    error = np.where(np.isfinite(error), error, np.nan)
    error = error[~np.isnan(error).all(axis=1)]
    if not len(error):
        return ErrorTrace(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    first = _bounds(len(error))
    low = np.minimum.reduceat(np.nanmin(error, axis=1), first)
    high = np.maximum.reduceat(np.nanmax(error, axis=1), first)
    return ErrorTrace(first, low, high)


def _bounds(count: int, most: int = _POINTS) -> IntArray:
    """Where each of `most` parts of `count` begins; at most `_POINTS`."""
    points = min(count, most, _POINTS)
    return np.arange(points, dtype=np.int64) * count // points


def _sums_of_squares(prediction: FloatArray, target: FloatArray) -> tuple[FloatArray, IntArray]:
    """Σe² of each sample over its elements that have a target, and their number."""
    there = ~np.isnan(target.reshape(len(target), -1))
    with np.errstate(all="ignore"):  # a prediction that has left the numbers shows as such
        error = (prediction - target).reshape(there.shape)
        squares = np.where(there, error * error, 0.0)
    return squares.sum(axis=1), there.sum(axis=1)
