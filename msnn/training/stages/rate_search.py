"""Finds the initial learning rate of a stage with a range test before the first epoch.

The rate grows from step to step (Smith 2017), and each step continues from the previous one. Losses
are of one fixed batch, so only the steps change them. They grow when the rate is too large. The
rate at the minimum is about the largest that still helped; training begins with `SHARE` of it. The
engine is restored afterwards.
"""

from __future__ import annotations

import math

import numpy as np

from msnn.data.dataset import IntArray
from msnn.data.rollout_rows import Runs
from msnn.training.engines.engine import Engine, NonFiniteLossError
from msnn.training.plans.epochs import order_key
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.stages.monitor import loss_values, weighted_total

FIRST = 1e-5
"""The smallest rate to try."""
RATIO = 1.333521432163324
"""Ratio of successive rates, 10^(1/8), as a literal that is equal on every machine."""
STEPS = 49
"""Number of rates, up to 10."""
SHARE = 0.3
"""Fraction of the rate at the minimum loss."""
USUAL = 1e-3
"""The rate if no tried rate lowers the loss."""
_TOO_FAR = 4.0
"""Factor over the minimum loss so far at which the search stops."""


def searched_rate(
    plan: StagePlan, engine: Engine, runs: Runs, attempt: int, spread: float
) -> float:
    """Searches the learning rate for one attempt at a stage with `lr: auto` (see the module).

    `runs` are the training rollouts, `spread` is the weight of priors. The engine is restored.
    """
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
    """The batch with index `number`: the indices of its rollouts; begins again after the last
    batch.
    """
    batches = -(-len(order) // size)
    begin = number % batches * size
    return np.ascontiguousarray(order[begin : begin + size])


def _total(plan: StagePlan, engine: Engine, runs: Runs) -> float:
    return weighted_total(plan, loss_values(plan, engine.measure(runs)))
