"""Finds the learning rate with which a stage begins: a range test before the first epoch.

Steps go through batches with a rate that grows from step to step (Smith 2017), each from where the
last one led. Losses are those of one batch, before and after each step, so that nothing but the
steps makes them differ. Where the rate is too large they grow; the rate at the least loss is about
the largest that still helped, and `SHARE` of it is what training begins with. The engine is then as
it was.
"""

from __future__ import annotations

import math

import numpy as np

from msnn.data.dataset import IntArray
from msnn.data.starts import Runs
from msnn.training.engines.engine import Engine, NonFiniteLossError
from msnn.training.plans.epoch_order import order_key
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.stages.monitor import loss_values, weighted_total

FIRST = 1e-5
"""The smallest rate that is tried."""
RATIO = 1.333521432163324
"""From one rate to the next: ten to the eighth, a literal that is the same on every machine."""
STEPS = 49
"""Up to a rate of 10."""
SHARE = 0.3
"""Of the rate at the least loss."""
USUAL = 1e-3
"""Where no rate lowers the loss."""
_TOO_FAR = 4.0
"""Times the least loss so far: larger rates only lead farther away."""


def searched_rate(
    plan: StagePlan, engine: Engine, runs: Runs, attempt: int, spread: float
) -> float:
    """The rate of the first epoch of an attempt at a stage."""
    order = engine.order(len(runs), order_key(plan.seed, plan.index, 0, attempt))
    size = plan.batch or len(order)
    # always the same batch: from batch to batch losses differ by more than a step changes them
    judged = runs.take(order[:size])
    kept, had_left_out = engine.state(), engine.has_left_out
    least, best = _total(plan, engine, judged), None
    rate = FIRST
    for number in range(STEPS):
        engine.begin_epoch(0, rate, attempt, spread)
        try:
            engine.train_batches(runs, size, _batch(order, size, number))
        except NonFiniteLossError:
            break
        total = _total(plan, engine, judged)
        if not math.isfinite(total) or total > _TOO_FAR * least:
            break
        if total < least:
            least, best = total, rate
        rate *= RATIO
    engine.restore(kept)
    # `state` does not have it
    engine.has_left_out = had_left_out
    return USUAL if best is None else SHARE * best


def _batch(order: IntArray, size: int, number: int) -> IntArray:
    """The batch of that number, from the first again after the last."""
    batches = -(-len(order) // size)
    begin = number % batches * size
    return np.ascontiguousarray(order[begin : begin + size])


def _total(plan: StagePlan, engine: Engine, runs: Runs) -> float:
    return weighted_total(plan, loss_values(plan, engine.measure(runs)))
