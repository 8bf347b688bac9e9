"""The series that change during a stage: dropout factors, and initial states of runs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from compiler.differentiation.estimated_starts import estimated_states, start_signal
from compiler.ir.types import Type
from msnn.data.dataset import FloatArray
from msnn.training.engines.dropout_masks import with_all_kept
from msnn.training.plans.stage_plan import StagePlan


def own_series(plan: StagePlan, series: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The series with separate arrays for those that change during the stage.

    Every dropout factor is 1 and every initial state is 0.
    """
    rows = len(next(iter(series.values()), np.zeros(0)))
    states = () if plan.rollout.starts is None else estimated_states(plan.rollout.starts.program)
    blank = {start_signal(s.name): np.zeros((rows, *Type(s.axes).shape)) for s in states}
    return {**with_all_kept(series, plan.masks), **blank}


def without_masks(plan: StagePlan, series: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The series without dropout factors: evaluations use no dropout."""
    masks = {mask.signal for mask in plan.masks}
    return {name: values for name, values in series.items() if name not in masks}
