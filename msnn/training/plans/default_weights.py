"""Weights default losses so that quantities with different units can be summed.

Without `losses:`, each output that predicts a signal has the loss mse. A sum of squared errors in
Pa² and K² would be dominated by Pa². Each loss is divided by the variance of its signal over the
training rows if signals have different units. So it is if their standard deviations differ by more
than a factor of 10. The total is then the sum of the unexplained fractions of variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from compiler.ir.program import Loss, Program
from msnn.data.dataset import Dataset
from msnn.training.plans.compared_signal import compared_signal
from msnn.training.plans.stage_data import TRAIN
from msnn.training.plans.stage_plan import StagePlan

MOST_UNLIKE = 10.0
"""Maximum ratio of standard deviations for which signals of one unit are summed unweighted."""


def with_default_weights(plans: Sequence[StagePlan], data: Dataset) -> list[StagePlan]:
    """The stages; stages without explicit weights get weights from the data if needed."""
    return [_weighed(plan, data) for plan in plans]


def _weighed(plan: StagePlan, data: Dataset) -> StagePlan:
    losses = [loss for loss in plan.program.losses if loss.is_default]
    if plan.has_written_weights or len(losses) < 2:
        return plan
    variances = {loss.name: _variance(plan.program, loss, data) for loss in losses}
    units = {plan.program.step[loss.prediction].type.unit for loss in losses}
    deviations = np.sqrt(list(variances.values()))
    if len(units) == 1 and deviations.max() <= MOST_UNLIKE * deviations.min():
        return plan
    weights = {name: 1.0 / variance for name, variance in variances.items()}
    return replace(plan, loss_weights={**plan.loss_weights, **weights}, weighs_by_variance=True)


def _variance(program: Program, loss: Loss, data: Dataset) -> float:
    """Mean variance of the elements of a signal; for a constant signal, its mean square."""
    signal = compared_signal(program, loss)
    assert signal is not None, "an output predicts a signal"
    rows = data.measured_values(signal)[data.in_set(TRAIN)]
    known = np.where(np.isfinite(rows), rows, np.nan).reshape(len(rows), -1)
    known = known[:, np.isfinite(known).any(axis=0)]
    if not known.size:
        return 1.0
    variance = float(np.mean(np.nanvar(known, axis=0)))
    return variance or float(np.nanmean(known * known)) or 1.0
