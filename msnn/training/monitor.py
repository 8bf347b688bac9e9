"""Decides which weights of a stage are best, by its losses over the watched rollouts."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from backends.raw_parameters import raw_value
from compiler.ir.program import Measure
from msnn.data.dataset import FloatArray
from msnn.data.starts import Runs
from msnn.simulation.rollout import entry_value
from msnn.training.engines.engine import LossSums
from msnn.training.engines.quadratic_terms import quadratic_terms
from msnn.training.plans.stage_data import TRAIN, StageData
from msnn.training.plans.stage_plan import TOTAL, StagePlan

Weights = Mapping[str, FloatArray]


def monitor(
    plan: StagePlan,
    evaluate: Callable[[Runs], LossSums],
    data: StageData,
    weights: Callable[[], Weights],
) -> float:
    """The monitored loss at the weights at which `evaluate` computes.

    Rows that were held out judge by the losses alone. On the rows of training the best total is
    that of what the steps of second order minimise, weight decay included.
    """
    values = loss_values(plan, evaluate(data.watched))
    if plan.monitor != TOTAL:
        return entry_value(plan.rollout.program, plan.monitor, values)
    total = weighted_total(plan, values)
    if data.watched_set == TRAIN and plan.optimizer.needs_squares and plan.weight_decay:
        total += _decay(plan, weights())
    return total


def _decay(plan: StagePlan, weights: Weights) -> float:
    moved = (plan.rollout.program.parameter(name) for name in plan.trained)
    raws = [raw_value(p, weights[p.name])[0].ravel() for p in moved]
    return quadratic_terms(np.concatenate(raws), plan.weight_decay).value


def loss_values(plan: StagePlan, sums: LossSums) -> dict[str, float]:
    """Each loss by its name."""
    measures: dict[str, Measure] = {loss.name: loss.measure for loss in plan.rollout.program.losses}
    return {name: value.value(measures[name]) for name, value in sums.items()}


def weighted_total(plan: StagePlan, values: Mapping[str, float]) -> float:
    """What the stage minimises."""
    return sum(weight * values[name] for name, weight in plan.loss_weights.items() if weight)
