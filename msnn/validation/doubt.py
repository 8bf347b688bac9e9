"""Detects limits so close to a metric that another engine's rounding could change the verdict.

Two engines agree to 1e-12 in one step, and to 1e-9 over simulations of contracting dynamics,
relative to the size a of the predictions. The errors of all samples then differ by at most √n a in
the Euclidean norm, which bounds Σe² and the variance of e. The mean and the maximum of |e| differ
by at most a.
"""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.validation.plan import CheckPlan
from msnn.validation.statistics.metrics import Errors, Spread, score

_APART = 1e-9
"""Maximum difference of predictions between engines, relative to the largest prediction."""

_OF_LOSSES = 1e-6
"""The same for a loss, whose residuals may be a thousandth of the prediction."""


def metric_in_doubt(plan: CheckPlan, errors: Errors, largest: float, parameters: int) -> bool:
    """True if a limit lies within the possible difference between two engines.

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
    """The same for a loss."""
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
