"""Evaluates one output while it is simulated: metrics, the course of errors, doubtful limits.

A limit is doubtful if another engine's rounding could change the verdict.
Two engines agree to 1e-12 in one step, and to 1e-9 over simulations of contracting dynamics,
relative to the size a of the predictions. The errors of all samples then differ by at most √n a in
the Euclidean norm, which bounds Σe² and the variance of e. The mean and the maximum of |e| differ
by at most a.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import prod, sqrt

import numpy as np

from msnn.data.dataset import Dataset, FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.validation.judged_errors import (
    NOT_JUDGED,
    TRAINED_ON,
    JudgedErrors,
    judged_errors,
)
from msnn.validation.plan import CheckPlan
from msnn.validation.ready_check import Counted, ReadyCheck
from msnn.validation.statistics.coverage import Coverage
from msnn.validation.statistics.metrics import Errors, Scores, Spread, score
from spec_schema.sections.training import Metric
from spec_schema.units.unit import Unit

UNIT_METRICS: tuple[Metric, ...] = ("rmse", "mae", "max_abs")
"""The metrics in the unit of the output."""
METRICS: tuple[Metric, ...] = (*UNIT_METRICS, "fit", "r2", "fvu", "aic")
_POINTS = 200
"""Maximum number of points per curve; longer curves combine steps or samples."""


@dataclass(frozen=True, slots=True)
class ErrorCurve:
    """RMSE by prediction step over all rollouts; it grows if a model feeds errors back.

    Point i is the RMSE over steps k = first[i] … last[i], counted from 1. Rollouts of up to 200
    steps have one step per point; longer ones, and the few over whole recordings, have several.
    Points without a target are omitted.
    """

    first: IntArray
    last: IntArray
    rmse: FloatArray
    scored: IntArray


@dataclass(frozen=True, slots=True)
class ErrorTrace:
    """The range of prediction − target along the scored samples, in order of rows.

    Samples of one row in overlapping rollouts belong to the same point.
    """

    sample: IntArray
    """Index of the first sample of each point."""
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, slots=True)
class MeanError:
    """The RMSE of the target around a constant, the simplest prediction."""

    rmse: float
    of: str
    """The rows whose mean is the constant: `training`, or `scored` without training rows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """One output compared with its target: one set of rollouts, all metrics."""

    of: str
    unit: Unit | None
    """Unit of the output, and of rmse, mae, max_abs and both curves."""
    horizon: str
    closed: tuple[str, ...]
    details: tuple[str, ...]
    """Further properties of the evaluation: `skip 20`, `against z[t]`."""
    data: str
    rows: str
    scored: int
    metrics: Mapping[Metric, Scores]
    mean: MeanError
    """The error of a constant prediction."""
    curve: ErrorCurve | None
    """None for one-step rollouts."""
    trace: ErrorTrace
    judged: JudgedErrors
    """The analysis of the errors."""
    coverage: Coverage | None = None
    """Coverage of prediction intervals, if requested."""

    @property
    def times_mean(self) -> float:
        """The RMSE relative to that of the mean; 0 where the targets do not differ from it."""
        rmse, mean = self.metrics["rmse"], self.mean.rmse
        if rmse.count < 2 or not mean > 0:
            return 0.0
        # errors that are no numbers are worse than any
        return rmse.value / mean if np.isfinite(rmse.value) else np.inf


def bounds(count: int, most: int = _POINTS) -> IntArray:
    """The start indices of at most `most` nearly equal parts of `count`."""
    # parts of whole numbers, as equal as they can be
    points = min(count, most, _POINTS)
    return np.arange(points, dtype=np.int64) * count // points


_APART = 1e-9
"""Maximum difference of predictions between engines, relative to the largest prediction."""

_OF_LOSSES = 1e-6
"""The same for a loss, whose residuals may be a thousandth of the prediction."""


def metric_in_doubt(plan: CheckPlan, errors: Errors, largest: float, parameters: int) -> bool:
    """True if a metric is so near to a limit that another engine's rounding could decide otherwise.

    `largest` is the size of the predictions; `parameters` is as for `score`.
    """
    if plan.metric is None or (plan.minimum is None and plan.maximum is None):
        return False
    both = [_moved(errors, sign * _APART * largest) for sign in (1.0, -1.0)]
    if plan.metric == "aic":  # Σe² / var e grows with the one and falls with the other
        bigger, smaller = both
        # Σe² and the variance of e may move apart: each is tried at both ends
        both += [replace(bigger, error=smaller.error), replace(smaller, error=bigger.error)]
    ends = [score(plan.metric, each, parameters).value for each in both]
    return _is_between(plan, min(ends), max(ends))


def loss_in_doubt(plan: CheckPlan, value: float) -> bool:
    """The same for the value of a loss: True if it is within rounding of a limit."""
    apart = _OF_LOSSES * abs(value)
    return _is_between(plan, value - apart, value + apart)


def _moved(errors: Errors, apart: float) -> Errors:
    """The errors of all elements, increased or reduced by `apart`."""
    # limits are kept by all elements together
    one = errors.joined()
    count = float(one.error.count[0])

    def norm(squares: FloatArray) -> FloatArray:
        # a sum of squares is moved by its root, and does not fall below 0
        return np.maximum(np.sqrt(squares) + apart * sqrt(count), 0.0) ** 2

    return Errors(
        shape=one.shape,
        absolute=np.maximum(one.absolute + apart * count, 0.0),
        squares=norm(one.squares),
        largest=np.maximum(one.largest + apart, 0.0),
        error=Spread(one.error.count, one.error.mean, norm(one.error.squares)),
        target=one.target,
    )


def _is_between(plan: CheckPlan, low: float, high: float) -> bool:
    limits = (plan.minimum, plan.maximum)
    return any(limit is not None and low <= limit <= high for limit in limits)


_SAMPLES = 20
"""Approximate samples per point of the curve, if only few rollouts reach a step."""


class CurveSums:
    """Sums of squared errors by step within the rollouts, from step `begin` on, for an error curve.

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
        """Adds predictions and targets, (samples, *shape), with the step of each within its
        rollout.
        """
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
    """The error of each row of the data, taken from the first rollout that predicts the row."""

    def __init__(self, rows: int, shape: tuple[int, ...]) -> None:
        self._errors = np.zeros((rows, *shape))
        self._seen = np.zeros(rows, np.bool_)

    def add(self, prediction: FloatArray, target: FloatArray, rows: IntArray) -> None:
        """Adds predictions, (samples, *shape), with their rows; the first one of each row
        is used.
        """
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
        """Adds predictions and targets, (samples, *shape), with their rows."""
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


def rows_text(data: Dataset, rows: IntArray) -> str:
    """A text such as `rows 5…1023 of 1024`, or counts for several recordings.

    `rows` are sorted and unique.
    """
    if not len(rows):
        return "no rows"
    # rows are counted from the beginning of their record, as files have them
    bounds = [(record.start, record.stop) for record in data.records]
    counts = np.diff(np.searchsorted(rows, bounds))[:, 0].tolist()
    touched = [record for record, count in zip(data.records, counts, strict=True) if count]
    if len(touched) > 1:
        total = sum(record.stop - record.start for record in touched)
        return f"{len(rows)} of {total} rows in {len(touched)} records"
    record = touched[0]
    first, last = int(rows[0]) - record.start, int(rows[-1]) - record.start
    total = record.stop - record.start
    if len(rows) == last - first + 1:
        return f"rows {first}…{last} of {total}"
    return f"{len(rows)} of rows {first}…{last} of {total}"


_AT_ONCE = 1 << 16
"""Samples added at once; limits the memory."""


class Measuring:
    """Collects the errors of one output during a simulation, and computes its metrics at the end.

    Memory is one value per row of the data.
    """

    def __init__(self, check: ReadyCheck, parts: Iterable[Runs], learned: int) -> None:
        """`parts` are the rollouts that will be added; `learned` is as for `score`."""
        self.of = check.plan.of
        self._check, self._counted, self._learned = check, Counted(check), learned
        assert check.plan.target is not None
        self._target = check.data.measured_values(check.plan.target.signal)
        begin, steps, samples = np.iinfo(np.int64).max, 0, 0
        for part in parts:
            number = self._counted.among(part).number
            begin = min(begin, int(number.min(initial=begin)))
            steps = max(steps, int(number.max(initial=-1)) + 1)
            samples += len(number)
        # rollouts over whole episodes or records are few and long
        few = isinstance(check.plan.rollout.horizon, str)
        self._curve = CurveSums(min(begin, steps), steps, samples, few=few)
        # made when the first rollout is added: of many entries one is measured at a time
        self._along: tuple[ErrorRange, RowErrors] | None = None
        """Allocated from the first rollouts to the last, so that one entry at a time uses
        memory.
        """
        self._errors = Errors.of(self._target[:0], self._target[:0])
        self._largest = 0.0

    def add(self, part: Runs, output: FloatArray) -> None:
        """Adds the simulated values of some rollouts."""
        if self._along is None:
            rows = self._check.data.rows
            self._along = ErrorRange(rows), RowErrors(rows, self._target.shape[1:])
        along, counting = self._along, self._counted.among(part)
        # some at a time: temporary arrays stay small however long the data are
        for begin in range(0, len(counting.rows), _AT_ONCE):
            some = slice(begin, begin + _AT_ONCE)
            rows = counting.rows[some]
            prediction, target = output[counting.steps[some]], self._target[rows]
            self._errors = self._errors + Errors.of(prediction, target)
            self._curve.add(prediction, target, counting.number[some])
            for each in along:
                each.add(prediction, target, rows)
            # a size to which rounding is relative: predictions that are not finite have none
            size = np.abs(prediction[np.isfinite(prediction)])
            self._largest = max(self._largest, float(size.max(initial=0.0)))

    def is_in_doubt(self, plan: CheckPlan) -> bool:
        """True if the rounding of another engine could move the metric across a limit of `plan`."""
        return metric_in_doubt(plan, self._errors, self._largest, self._learned)

    def _mean_error(self) -> MeanError:
        """The RMSE of each element's mean as prediction: √((Σ(target − m)²) / n)."""
        target, data = self._errors.target, self._check.data
        of, constant = "scored", target.mean
        if TRAINED_ON in data.sets:
            trained = self._target[data.set_of_row == data.sets.index(TRAINED_ON)]
            trained = trained.reshape(len(trained), len(target.mean))
            found = Spread.of(trained, ~np.isnan(trained))
            if (found.count > 0).all():
                of, constant = "training", found.mean
        # Σ(y − m)² = Σ(y − ȳ)² + n (ȳ − m)²
        squares = target.squares + target.count * (target.mean - constant) ** 2
        return MeanError(float(np.sqrt(squares.sum() / max(target.count.sum(), 1))), of)

    def measurement(self, *, judges: bool) -> Measurement:
        """The metrics of everything that was added; `judges` adds the analysis of errors."""
        assert self._along is not None, "there are rollouts"
        # handed over and let go: the next entry may need the memory
        (extremes, by_row), self._along = self._along, None
        check, rollout = self._check, self._check.plan.rollout
        metrics: dict[Metric, Scores] = {
            metric: score(metric, self._errors, self._learned) for metric in METRICS
        }
        rows = by_row.rows
        # rows without a target are simulated, not scored (R9)
        there = ~np.isnan(self._target[rows].reshape(len(rows), -1)).all(axis=1)
        return Measurement(
            of=check.plan.of,
            unit=check.plan.error_unit,
            horizon=str(rollout.horizon),
            closed=rollout.closed,
            details=check.plan.details,
            data=check.name,
            rows=rows_text(check.data, rows[there]),
            scored=metrics["rmse"].count,
            metrics=metrics,
            mean=self._mean_error(),
            curve=self._curve.curve(),
            trace=extremes.trace(),
            judged=judged_errors(check, rows, by_row.errors) if judges else NOT_JUDGED,
        )
