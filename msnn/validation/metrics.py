"""Measures how well predictions meet their targets: one number a metric, for all and for each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray
from spec_schema.sections.validation import Metric


@dataclass(frozen=True, slots=True)
class Scores:
    """A metric over everything, and over each element of a vector (its shape; scalar: ())."""

    value: float
    elements: FloatArray
    count: int
    """Elements that had a target."""


def score(
    metric: Metric, prediction: FloatArray, target: FloatArray, parameters: int = 0
) -> Scores:
    """The metric of (samples, *shape) arrays; elements whose target is NaN are left out.

    rmse = √(mean e²), mae = mean |e|, max_abs = max |e| with e = prediction − target;
    fvu = Σe² / Σ(target − its mean)², r2 = 1 − fvu, fit = 100·(1 − √fvu) in percent (Ljung).
    aic = n ln(2π var e) + Σe²/var e + 2p, the variance about the mean of e, with n scored elements
    and p learned numbers, `parameters` (Akaike 1974).
    The mean is each element's own. NaN where nothing is scored or the target is constant.
    """
    there = ~np.isnan(target)
    error = np.where(there, prediction - target, 0.0)
    count = np.asarray(there.sum(axis=0), dtype=np.int64)
    with np.errstate(all="ignore"):
        mean = np.where(there, target, 0.0).sum(axis=0) / count
        spread = np.where(there, target - mean, 0.0)
        if metric == "aic":
            return _criteria(error, there, parameters)
        value = _value(metric, error.ravel(), int(count.sum()), spread.ravel())
        flat_error = error.reshape(len(error), -1)
        flat_spread = spread.reshape(len(error), -1)
        each = [
            _value(metric, flat_error[:, i], n, flat_spread[:, i])
            for i, n in enumerate(count.ravel().tolist())
        ]
    return Scores(value, np.array(each).reshape(target.shape[1:]), int(count.sum()))


def _criteria(error: FloatArray, there: BoolArray, parameters: int) -> Scores:
    """Akaike's criterion of Gaussian errors; of each element with all parameters."""

    def criterion(values: FloatArray) -> float:
        if not len(values):
            return float("nan")
        variance = float(np.var(values))
        likely = len(values) * np.log(2 * np.pi * variance) + np.sum(values * values) / variance
        return float(likely + 2 * parameters)

    flat_error, flat_there = error.reshape(len(error), -1), there.reshape(len(error), -1)
    each = [criterion(flat_error[flat_there[:, i], i]) for i in range(flat_error.shape[1])]
    elements = np.array(each).reshape(error.shape[1:])
    return Scores(criterion(error[there]), elements, int(there.sum()))


def _value(metric: Metric, error: FloatArray, count: int, spread: FloatArray) -> float:
    if not count:
        return float("nan")
    match metric:
        case "rmse":
            return float(np.sqrt(np.sum(error * error) / count))
        case "mae":
            return float(np.sum(np.abs(error)) / count)
        case "max_abs":
            return float(np.max(np.abs(error)))
        case "fvu":
            return _unexplained(error, spread)
        case "r2":
            return 1.0 - _unexplained(error, spread)
        case "fit":
            return 100.0 * (1.0 - float(np.sqrt(_unexplained(error, spread))))
        case "aic":
            raise AssertionError("it takes the scored errors alone, and the parameters")
        case _:
            assert_never(metric)


def _unexplained(error: FloatArray, spread: FloatArray) -> float:
    total = float(np.sum(spread * spread))
    return float(np.sum(error * error)) / total if total > 0 else float("nan")
