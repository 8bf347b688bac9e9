"""Computes the monitor of a stage, the loss by which its best weights are selected."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from backends.raw_parameters import raw_value
from compiler.ir.program import Measure
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.errors.learning.training import no_target_scored
from msnn.simulation.rollout import entry_value
from msnn.simulation.rollout_plan import start_signals
from msnn.training.engines.engine import LossSums
from msnn.training.plans.loss_terms import distance, has_priors, residuals_of
from msnn.training.plans.stage_data import TRAIN, StageData
from msnn.training.plans.stage_plan import TOTAL, StagePlan
from spec_schema.diagnostics.diagnostic import SpecError

Weights = Mapping[str, FloatArray]


def monitor(
    plan: StagePlan,
    evaluate: Callable[[Runs], LossSums],
    data: StageData,
    weights: Callable[[], Weights],
) -> float:
    """The monitored loss at the current weights of `evaluate`.

    On held-out rows it consists of the losses alone. On training rows it is the complete minimised
    total: decay that is not decoupled adds λ/2 Σ raw². With priors it is F + mse · (exp(Σ ((p −
    mean)/std)²/n) − 1), whose minimum is that of log mse + Σ ((p − mean)/std)²/n. Raises SpecError
    if losses have targets but no target row is scored.
    """
    sums = evaluate(data.watched)
    _require_targets(plan, sums, data.watched_set)
    values = loss_values(plan, sums)
    if plan.monitor != TOTAL:
        return entry_value(plan.rollout.program, plan.monitor, values)
    total = weighted_total(plan, values)
    if data.watched_set != TRAIN:
        return total
    if plan.decay_of_total:
        total += _decay(plan, weights())
    if has_priors(plan):
        found = residuals_of(plan, sums, data.watched)
        if found.count:
            with np.errstate(over="ignore"):
                # infinite far from the priors, which is worse than any other and never the best
                total += found.square * float(np.expm1(distance(plan, weights()) / found.count))
    return total


def _require_targets(plan: StagePlan, sums: LossSums, name: str) -> None:
    losses = plan.rollout.program.losses
    compared = [
        one.name for one in losses if one.target is not None and plan.loss_weights[one.name]
    ]
    if compared and not any(sums[one].count for one in compared):
        raise SpecError(
            (
                no_target_scored(
                    plan.name, name, plan.span, plan.rollout.horizon, start_signals(plan.rollout)
                ),
            )
        )


def _decay(plan: StagePlan, weights: Weights) -> float:
    moved = (plan.rollout.program.parameter(name) for name in plan.trained)
    raws = [raw_value(p, weights[p.name])[0].ravel() for p in moved]
    raw = np.concatenate(raws)
    return 0.5 * plan.decay_of_total * float(raw @ raw)


def loss_values(plan: StagePlan, sums: LossSums) -> dict[str, float]:
    """The value of each loss, by name, from its sum and count."""
    measures: dict[str, Measure] = {loss.name: loss.measure for loss in plan.rollout.program.losses}
    return {name: value.value(measures[name]) for name, value in sums.items()}


def weighted_total(plan: StagePlan, values: Mapping[str, float]) -> float:
    """The total: the weighted sum of the loss values."""
    return sum(weight * values[name] for name, weight in plan.loss_weights.items() if weight)
