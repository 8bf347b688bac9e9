"""Measures an output that was simulated one way: every metric, and where it errs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray, IntArray
from msnn.validation.judged_errors import JudgedErrors
from msnn.validation.statistics.coverage import Coverage
from msnn.validation.statistics.metrics import Scores
from spec_schema.sections.validation import Metric
from spec_schema.units.unit import Unit

METRICS: tuple[Metric, ...] = ("rmse", "mae", "max_abs", "fit", "r2", "fvu", "aic")
_POINTS = 200
"""The most points of a curve; more steps or samples than that share points."""


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
    """The range of prediction − target along the scored samples, in order of rows.

    Samples of one row, which rollouts that overlap have, are one point's.
    """

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
    details: tuple[str, ...]
    """What else its entry says of how it is measured: `skip 20`, `against z[t]`."""
    data: str
    rows: str
    scored: int
    metrics: Mapping[Metric, Scores]
    curve: ErrorCurve | None
    """None where every rollout is one step."""
    trace: ErrorTrace
    judged: JudgedErrors
    """What the errors tell of the model."""
    coverage: Coverage | None = None
    """How often targets lie inside prediction intervals, where these were asked for."""


def bounds(count: int, most: int = _POINTS) -> IntArray:
    """The beginning of each of `most` parts of `count`; at most as many as a curve has."""
    # parts of whole numbers, as equal as they can be
    points = min(count, most, _POINTS)
    return np.arange(points, dtype=np.int64) * count // points
