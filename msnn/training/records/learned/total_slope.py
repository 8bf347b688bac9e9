"""Differentiates the total of a stage at its final weights, for any losses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from backends.files.c_compiler import CompilerMissingError
from backends.native.kernel import Kernel
from backends.native.variables import by_parameter, flat
from compiler.differentiation.interpreted_training import InterpretedTraining
from compiler.differentiation.training_step import training_step
from compiler.interpreter.bounded import Total
from compiler.interpreter.rounding import Rollouts
from msnn.data.dataset import Dataset, FloatArray
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import own_series
from msnn.training.engines.native.native_engine import try_natively
from msnn.training.plans.stage_data import StageData
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.records.learned.beside_bounds import beside_bounds_by_slope, is_near_bound
from msnn.training.records.learned.standard_errors import StandardErrors
from spec_schema.sections.optimizers import Lbfgs

_LOOKED_AT = 100
"""Maximum number of rollouts, and of steps of each, if the reference interpreter is used."""


@dataclass(frozen=True, slots=True)
class TotalSlope:
    """The total loss over the rollouts of a stage, and its gradient by parameter, in physical
    values.
    """

    total: float
    slope: Mapping[str, FloatArray]


def with_bounds(
    found: StandardErrors,
    plan: StagePlan,
    data: Dataset,
    stage: StageData,
    weights: Mapping[str, FloatArray],
) -> StandardErrors:
    """Adds which parameters are at bounds, by the gradient, if standard errors did not determine
    it.
    """
    parameters = [plan.program.parameter(name) for name in plan.trained]
    near = any(is_near_bound(p, weights[p.name]).any() for p in parameters)
    if found.beside is not None or not near:
        return found
    known = total_slope(plan, data, stage, weights)
    if known is None or not np.isfinite(known.total):
        return found
    beside = beside_bounds_by_slope(parameters, weights, known.slope, known.total)
    return replace(found, beside=beside)


def total_slope(
    plan: StagePlan, data: Dataset, stage: StageData, weights: Mapping[str, FloatArray]
) -> TotalSlope | None:
    """The total without dropout, priors and weight decay, and its gradient.

    None if initial states of runs are estimated, or with several processes.
    """
    if plan.rollout.starts is not None or plan.ranks is not None:
        return None

    def native(as_it_runs: StagePlan) -> TotalSlope:
        return _by_kernel(as_it_runs, data, stage, weights)

    if plan.engine != "torch" and not plan.optimizer.needs_squares:
        try:
            # what is trained is not refused now, and what it said of kernels was said
            tried = try_natively(replace(plan, engine="auto"), native, in_double=False)
            if tried.made is not None:
                return tried.made
        except CompilerMissingError:
            pass
    return _by_interpreter(plan, data, stage, weights)


def _by_kernel(
    plan: StagePlan, data: Dataset, stage: StageData, weights: Mapping[str, FloatArray]
) -> TotalSlope:
    program = plan.program
    # the kernel of the training, which is there already
    kernel = Kernel(
        program,
        plan.dtype,
        plan.threads,
        reproducible=plan.reproducible,
        lbfgs=isinstance(plan.optimizer, Lbfgs),
    )
    names = kernel.source.losses
    found = kernel.losses(
        kernel.data(own_series(plan, data.series), plan.rollout.skip, stage.train_rows),
        kernel.groups(stage.train.t0, stage.train.steps),
        flat(program, weights),
        [plan.loss_weights[name] for name in names],
        gradient=True,
    )
    measures = {loss.name: loss.measure for loss in program.losses}
    total = sum(
        plan.loss_weights[name] * LossSum(float(value), float(count)).value(measures[name])
        for name, value, count in zip(names, found.sums, found.counts, strict=True)
        if count
    )
    return TotalSlope(total, by_parameter(program, found.gradient))


def _by_interpreter(
    plan: StagePlan, data: Dataset, stage: StageData, weights: Mapping[str, FloatArray]
) -> TotalSlope | None:
    """The total and gradient of the first rollouts; None with masked rows, which it does not
    support.
    """
    if stage.train_rows is not None:
        return None
    steps = min(int(stage.train.steps[0]), _LOOKED_AT)
    t0 = stage.train.t0[stage.train.steps >= steps][:_LOOKED_AT]
    skip = min(plan.rollout.skip, steps - 1)
    runs = Rollouts(own_series(plan, data.series), t0, steps, skip)
    training = InterpretedTraining(training_step(plan.program), weights, np.dtype(np.float64))
    found = training.losses(runs, plan.loss_weights)
    total = 0.0
    for loss in plan.program.losses:
        one = LossSum(_value(found.sums[loss.name]), _value(found.counts[loss.name]))
        if one.count:
            total += plan.loss_weights[loss.name] * one.value(loss.measure)
    return TotalSlope(total, {name: np.asarray(one.value) for name, one in found.gradient.items()})


def _value(total: Total) -> float:
    return float(np.asarray(total.value))
