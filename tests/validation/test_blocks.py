"""Metrics, curves and traces are the same however the rollouts are divided into blocks."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.validation import measurement, outcomes
from msnn.validation.measurement import METRICS
from msnn.validation.statistics.metrics import Errors, score
from msnn.validation.validate import ValidationReport, validate
from tests.training.cases import dataset, gain, gain_series

CHECKS = """
  - {of: x_next, rollout: {horizon: 9, stride: 1, skip: 2}}
  - {of: x_next, rollout: {horizon: 40, stride: 3}, metric: aic}
  - {of: x_next, rollout: record}
  - {of: x_next}
"""


def report() -> ValidationReport:
    program, spec = gain(more=f"validate:{CHECKS}")
    series = gain_series(300)
    series["x"][[77, 190]] = np.nan
    return validate(program, dataset(series, test=[200, 100]), spec.checks, {"a": np.array(0.5)})


def test_blocks_change_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = report()
    monkeypatch.setattr(outcomes, "_STEPS", 1)  # as many as the data have rows
    monkeypatch.setattr(measurement, "_AT_ONCE", 7)
    for ours, theirs in zip(report().measurements, whole.measurements, strict=True):
        assert (ours.rows, ours.scored) == (theirs.rows, theirs.scored)
        for metric in METRICS:
            expected = pytest.approx(theirs.metrics[metric].value, rel=1e-12, nan_ok=True)
            assert ours.metrics[metric].value == expected
        if theirs.curve is not None:
            assert ours.curve is not None
            np.testing.assert_array_equal(ours.curve.scored, theirs.curve.scored)
            np.testing.assert_allclose(ours.curve.rmse, theirs.curve.rmse, rtol=1e-12)
        np.testing.assert_array_equal(ours.trace.sample, theirs.trace.sample)
        np.testing.assert_array_equal(ours.trace.low, theirs.trace.low)
        assert repr(ours.judged) == repr(theirs.judged)


def test_metrics_of_parts_are_those_of_the_whole() -> None:
    """Vectors, targets that are missing, a mean far from 0, and a target that never changes."""
    random = np.random.default_rng(0)
    target = 1e6 + random.normal(size=(500, 3))
    target[::7, 1] = np.nan
    target[:, 2] = 0.1
    prediction = target + random.normal(size=target.shape)
    parts = [slice(0, 1), slice(1, 7), slice(7, 7), slice(7, 400), slice(400, 500)]
    found = Errors.of(prediction[:0], target[:0])
    for part in parts:
        found = found + Errors.of(prediction[part], target[part])
    for metric in METRICS:
        ours, whole = score(metric, found, 4), score(metric, Errors.of(prediction, target), 4)
        np.testing.assert_allclose(ours.elements, whole.elements, rtol=1e-9)
        assert ours.value == pytest.approx(whole.value, rel=1e-9)
        assert np.isnan(ours.elements[2]) == (metric in ("fit", "r2", "fvu"))
    error = (prediction - target)[:, 0]
    spread = target[:, 0] - target[:, 0].mean()
    fvu = np.sum(error**2) / np.sum(spread**2)
    assert score("fvu", found).elements[0] == pytest.approx(fvu, rel=1e-9)
