"""Decides which weights of a stage are best, by its losses over the watched rollouts."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from compiler.ir.program import Measure
from msnn.data.starts import Runs
from msnn.simulation.rollout import entry_value
from msnn.training.engines.engine import LossSums
from msnn.training.plans.stage_plan import TOTAL, StagePlan


def monitor(plan: StagePlan, evaluate: Callable[[Runs], LossSums], watched: Runs) -> float:
    """The monitored loss at the weights at which `evaluate` computes."""
    values = loss_values(plan, evaluate(watched))
    if plan.monitor == TOTAL:
        return weighted_total(plan, values)
    return entry_value(plan.rollout.program, plan.monitor, values)


def loss_values(plan: StagePlan, sums: LossSums) -> dict[str, float]:
    """Each loss by its name."""
    measures: dict[str, Measure] = {loss.name: loss.measure for loss in plan.rollout.program.losses}
    return {name: value.value(measures[name]) for name, value in sums.items()}


def weighted_total(plan: StagePlan, values: Mapping[str, float]) -> float:
    """What the stage minimises."""
    return sum(weight * values[name] for name, weight in plan.loss_weights.items() if weight)
