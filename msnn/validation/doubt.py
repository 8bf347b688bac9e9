"""Tells where a limit lies so near that another engine's rounding could be on its other side.

Two engines agree to 1e-12 in one step and to 1e-9 over free runs whose dynamics contract, relative
to the size of what they predict. Every metric grows with the sizes of the errors, so that errors
which are all larger or all smaller by that much enclose what another engine would find.
"""

from __future__ import annotations

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.validation.metrics import score
from msnn.validation.plan import CheckPlan

_APART = 1e-9
"""What two engines may differ in predictions, relative to the largest."""

_OF_LOSSES = 1e-6
"""The same of a loss: its residuals may be a thousandth of what is predicted."""


def metric_in_doubt(plan: CheckPlan, prediction: FloatArray, target: FloatArray, p: int) -> bool:
    """Whether a limit lies between the values that two engines may find; `p` as of `score`."""
    if plan.metric is None or (plan.minimum is None and plan.maximum is None):
        return False
    finite = prediction[np.isfinite(prediction)]
    apart = _APART * float(np.max(np.abs(finite), initial=0.0))
    error = prediction - target
    outer = error + np.copysign(apart, error)
    inner = np.copysign(np.maximum(np.abs(error) - apart, 0.0), error)
    ends = [score(plan.metric, target + each, target, p).value for each in (outer, inner)]
    return _is_between(plan, min(ends), max(ends))


def loss_in_doubt(plan: CheckPlan, value: float) -> bool:
    """The same of a loss."""
    apart = _OF_LOSSES * abs(value)
    return _is_between(plan, value - apart, value + apart)


def _is_between(plan: CheckPlan, low: float, high: float) -> bool:
    limits = (plan.minimum, plan.maximum)
    return any(limit is not None and low <= limit <= high for limit in limits)
