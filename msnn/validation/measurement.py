"""Evaluates one output for one kind of simulation: all metrics, and the course of its errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray, IntArray
from msnn.validation.judged_errors import JudgedErrors
from msnn.validation.statistics.coverage import Coverage
from msnn.validation.statistics.metrics import Scores
from spec_schema.sections.training import Metric
from spec_schema.units.unit import Unit

METRICS: tuple[Metric, ...] = ("rmse", "mae", "max_abs", "fit", "r2", "fvu", "aic")
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
    curve: ErrorCurve | None
    """None for one-step rollouts."""
    trace: ErrorTrace
    judged: JudgedErrors
    """The analysis of the errors."""
    coverage: Coverage | None = None
    """Coverage of prediction intervals, if requested."""


def bounds(count: int, most: int = _POINTS) -> IntArray:
    """The start indices of at most `most` nearly equal parts of `count`."""
    # parts of whole numbers, as equal as they can be
    points = min(count, most, _POINTS)
    return np.arange(points, dtype=np.int64) * count // points
