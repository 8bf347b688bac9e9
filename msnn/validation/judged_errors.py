"""Analyses the errors of one measurement: correlations, and input regions with large errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from compiler.ir.program import Role
from msnn.data.dataset import Dataset, FloatArray, IntArray
from msnn.validation.ready_check import ReadyCheck
from msnn.validation.statistics.correlations import ErrorsOfElement, lags_of, residuals

_PARTS = 4
_MARGIN = 1e-9
"""Tolerance for leaving a range by rounding, relative to the range."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """A quarter of the scored samples, by the value of an input at the time of prediction."""

    low: float
    high: float
    rmse: float
    scored: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Extrapolation:
    """The scored samples at which an input is outside the range that it has in training."""

    signal: str
    share: float
    """Fraction of the scored samples, 0 to 1."""
    low: float
    """The range of the training rows."""
    high: float


def regions(squares: FloatArray, values: FloatArray) -> tuple[Region, ...]:
    """The RMSE in each quarter of the values; fewer parts with repeated values.

    `squares` are mean squared errors of samples, `values` those of an input; NaN is ignored. Empty
    if all values are equal.
    """
    known = np.isfinite(squares) & np.isfinite(values)
    squares, values = squares[known], values[known]
    if not len(values):
        return ()
    # quarters of samples, not of the range: each holds as many
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _PARTS + 1)))
    if len(edges) < 2:
        return ()
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    found: list[Region] = []
    for number in range(len(edges) - 1):
        inside = place == number
        if inside.any():
            found.append(
                Region(
                    low=float(values[inside].min()),
                    high=float(values[inside].max()),
                    rmse=float(np.sqrt(squares[inside].mean())),
                    scored=int(inside.sum()),
                )
            )
    return tuple(found)


def extrapolation(signal: str, values: FloatArray, trained: FloatArray) -> Extrapolation | None:
    """The share of an input's samples that lie outside the range of its training values.

    None if no sample does. `values` are the samples that are measured on, `trained` those of the
    training rows.
    """
    values, trained = values[np.isfinite(values)], trained[np.isfinite(trained)]
    if not len(values) or not len(trained):
        return None
    low, high = float(trained.min()), float(trained.max())
    # rounding at the ends of the range is no extrapolation
    margin = _MARGIN * (high - low)
    share = float(np.mean((values < low - margin) | (values > high + margin)))
    return Extrapolation(signal=signal, share=share, low=low, high=high) if share else None


TRAINED_ON = "train"
_MOST_SIGNALS = 40
"""Maximum number of input elements that are analysed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedErrors:
    """The analysis of an output's errors: correlations, error by region of inputs,
    extrapolation.
    """

    residuals: tuple[ErrorsOfElement, ...]
    """Correlations per element."""
    regions: Mapping[str, tuple[Region, ...]]
    """RMSE over all elements by region of each input."""
    extrapolations: tuple[Extrapolation, ...]
    """Inputs outside the range of the training rows."""


NOT_JUDGED = JudgedErrors(residuals=(), regions={}, extrapolations=())
"""The result if only metrics are requested."""


def judged_errors(check: ReadyCheck, rows: IntArray, errors: FloatArray) -> JudgedErrors:
    """Analyses errors, (rows, *shape), at these rows of the data, which are sorted and unique."""
    assert check.plan.target is not None
    signals = _inputs(check)
    # an input is judged at the step that predicted, k samples before what it predicted
    before = rows - check.plan.target.ahead
    with np.errstate(over="ignore", invalid="ignore"):
        flat = errors.reshape(len(errors), -1) if len(errors) else errors.reshape(0, 1)
        squares = np.mean(flat * flat, axis=1)
    sample_time = check.plan.rollout.program.sample_time
    lags = lags_of(sample_time)
    records = _records(check.data, rows)
    places = _places(check.data, sample_time, lags)[rows]
    beside = {name: values[rows] for name, values in signals.items()}
    return JudgedErrors(
        residuals=tuple(residuals(errors, places, records, beside, lags)),
        regions={name: regions(squares, values[before]) for name, values in signals.items()},
        extrapolations=tuple(
            far
            for name, values in signals.items()
            if (far := _extrapolation(check, name, values, before)) is not None
        ),
    )


def _extrapolation(
    check: ReadyCheck, name: str, values: FloatArray, rows: IntArray
) -> Extrapolation | None:
    data = check.data
    # on the rows that were trained on nothing is beyond them
    if TRAINED_ON not in data.sets or check.name == TRAINED_ON:
        return None
    return extrapolation(name, values[rows], values[data.in_set(TRAINED_ON)])


def _inputs(check: ReadyCheck) -> dict[str, FloatArray]:
    """Each element of the inputs that are not fed back, over all rows: `u`, `q[0]`, …"""
    rollout, found = check.plan.rollout, dict[str, FloatArray]()
    for signal in rollout.program.signals:
        # what is fed back is made of the model's own errors
        if signal.role is not Role.INPUT or signal.name in rollout.closed:
            continue
        values = check.data.series[signal.name]
        if values.ndim == 1:
            found[signal.name] = values
            continue
        for index in np.ndindex(values.shape[1:]):
            element = (slice(None), *index)
            found[f"{signal.name}[{', '.join(map(str, index))}]"] = values[element]
    # each is a correlation over all rows: of hundreds of inputs the first say enough
    return dict(list(found.items())[:_MOST_SIGNALS])


def _records(data: Dataset, rows: IntArray) -> IntArray:
    """The index of the recording that each row belongs to."""
    starts = np.array([record.start for record in data.records])
    # records follow each other: the last that begins before a row holds it
    return np.searchsorted(starts, rows, side="right") - 1


def _places(data: Dataset, sample_time: float | None, lags: int) -> IntArray:
    """The positions of rows in samples; across a gap they differ by its duration.

    Across a gap of unknown duration, they differ by more than the longest lag.
    """
    steps = np.ones(data.rows, np.int64)
    steps[~np.asarray(data.continues)] = lags + 1
    for piece in (piece for record in data.records for piece in record.pieces):
        if piece.time is None or sample_time is None:
            continue
        inside = slice(piece.start + 1, piece.stop)
        gaps = ~np.asarray(data.continues[inside])
        length = np.diff(piece.time)[gaps] / sample_time
        # a clock that was set back, or stood still, tells nothing
        known = np.where(length > 0, np.clip(np.rint(length), 1, lags + 1), lags + 1)
        steps[inside][gaps] = known.astype(np.int64)
    return np.cumsum(steps)
