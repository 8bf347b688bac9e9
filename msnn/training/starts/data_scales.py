"""Determines the scales of parameters with `scale: data`, before the first stage.

The scale of a parameter is the change that moves predictions by one standard deviation of the
target: 1/√(Σ over losses of ⟨(∂prediction/∂p)²⟩ / σ²). Derivatives are taken at the initial weights
along rollouts of the stage; σ is the standard deviation of the target's signal over the training
rows. Equal steps in raw variables then change predictions equally in any units. For an array, the
element with the largest effect determines the scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from compiler.differentiation.interpreted_training import interpreted_products
from compiler.differentiation.sensitivities import sensitivities
from compiler.interpreter.rounding import Rollouts
from compiler.ir.program import Loss, Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.errors.learning import stages
from msnn.simulation.rollout_plan import set_rollouts
from msnn.simulation.start_fit import fit_of
from msnn.training.plans.loss_terms import squared
from msnn.training.plans.stage_data import TRAIN, compared_signal
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Findings, SpecError

MOST_ROLLOUTS = 32
MOST_STEPS = 100
"""Maximum steps of the sampled rollouts, because the reference interpreter is slow."""


def with_data_scales(
    plans: Sequence[StagePlan], data: Dataset, weights: Mapping[str, FloatArray]
) -> list[StagePlan]:
    """The stages with scales from the data; each scale comes from the first stage that trains it.

    Raises SpecError for a parameter that affects no compared prediction.
    """
    scales: dict[str, float] = {}
    for plan in plans:
        asked = [
            name
            for name in plan.trained
            if plan.program.parameter(name).scales_by_data and name not in scales
        ]
        if asked:
            scales |= _scales(plan, asked, data, weights)
    return [_scaled(plan, scales) for plan in plans] if scales else list(plans)


def _scales(
    plan: StagePlan, names: Sequence[str], data: Dataset, weights: Mapping[str, FloatArray]
) -> dict[str, float]:
    program = squared(plan.rollout.program, plan.loss_weights)
    rollout = replace(plan.rollout, program=program)
    runs = set_rollouts(rollout, data, TRAIN, None, "scales", plan.span, Findings())
    assert runs is not None, "the stage has rollouts"
    steps = min(MOST_STEPS, int(runs.steps.max()))
    # of one length, so that every element below has the same number of squares in its sum
    long = np.flatnonzero(runs.steps >= steps)
    # rounding names a run twice where there are fewer than MOST_ROLLOUTS
    few = runs.take(
        long[np.unique(np.linspace(0, len(long) - 1, MOST_ROLLOUTS).round().astype(int))]
    )
    skip = min(plan.rollout.skip, steps - 1)
    fit, series = fit_of(plan.rollout), data.series
    if fit is not None:
        begun = fit.find(series, few, weights, plan.loss_weights)
        series = {**series, **begun.series(data.rows)}
    log = Rollouts(series, few.t0, steps, skip)
    found = interpreted_products(sensitivities(program, names), weights, log)
    total = np.zeros(sum(weights[name].size for name in names))
    for loss in program.losses:
        if loss.name not in found:
            continue
        products = np.asarray(found[loss.name].products.value, float)
        if products.ndim == 3:
            products = products.sum(axis=0)
        # of [J r]ᵀ[J r]: the last one is Σ r²
        square = np.diagonal(products)
        size = _deviation(program, loss, data)
        # the mean is over what is compared: a missing target has no square in the sum
        scored = float(found[loss.name].count.value)
        if not scored:
            continue
        # without a deviation the residuals at the first weights are the yardstick
        wanted = square[-1] / scored if size is None else size * size
        if wanted > 0:
            total += square[:-1] / scored / wanted
    scales: dict[str, float] = {}
    for name, part in zip(names, np.split(total, _ends(names, weights)), strict=True):
        # steps have one length for the whole array, and its most sensitive element must bear it
        largest = float(part.max())
        if not (np.isfinite(largest) and largest > 0):
            place = program.parameter(name).span
            raise SpecError((stages.no_scale_of_data(name, place),))
        scales[name] = 1.0 / float(np.sqrt(largest))
    return scales


def _ends(names: Sequence[str], weights: Mapping[str, FloatArray]) -> list[int]:
    return np.cumsum([weights[name].size for name in names])[:-1].tolist()


def _deviation(program: Program, loss: Loss, data: Dataset) -> float | None:
    """The standard deviation of the target signal of a loss; None if the target is not a signal."""
    signal = compared_signal(program, loss)
    if signal is None:
        return None
    rows = data.series[signal][data.in_set(TRAIN)]
    known = rows[np.isfinite(rows)]
    # a signal that never changes has a deviation of 0, by which nothing can be divided
    return float(np.std(known)) or None


def _scaled(plan: StagePlan, scales: Mapping[str, float]) -> StagePlan:
    rollout = replace(plan.rollout, program=with_scales(plan.rollout.program, scales))
    return replace(plan, program=with_scales(plan.program, scales), rollout=rollout)


def with_scales(program: Program, scales: Mapping[str, float]) -> Program:
    """The program in which the parameters named in `scales` have these scales."""
    parameters = tuple(
        replace(p, scale=scales[p.name]) if p.name in scales else p for p in program.parameters
    )
    return replace(program, parameters=parameters)
