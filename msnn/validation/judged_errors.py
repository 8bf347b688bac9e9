"""Analyses the errors of one measurement: correlations, and regions with large errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from compiler.ir.program import Role
from msnn.data.dataset import Dataset, FloatArray, IntArray
from msnn.validation.ready_check import ReadyCheck
from msnn.validation.statistics.correlations import ErrorsOfElement, lags_of, residuals
from msnn.validation.statistics.regions import Extrapolation, Region, extrapolation, regions

TRAINED_ON = "train"
_MOST_SIGNALS = 40
"""Maximum number of input elements that are analysed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedErrors:
    """The analysis of an output's errors."""

    residuals: tuple[ErrorsOfElement, ...]
    """Correlations per element."""
    regions: Mapping[str, tuple[Region, ...]]
    """RMSE over all elements by region of each input."""
    extrapolations: tuple[Extrapolation, ...]
    """Inputs outside the range of the training rows."""


NOT_JUDGED = JudgedErrors(residuals=(), regions={}, extrapolations=())
"""The result if only metrics are requested."""


def judged_errors(check: ReadyCheck, rows: IntArray, errors: FloatArray) -> JudgedErrors:
    """Analyses the errors of sorted, unique rows."""
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
    """The index of the recording of each row."""
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
