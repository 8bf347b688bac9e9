"""The series that change while a stage runs: factors of dropout, and where runs start."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from compiler.differentiation.estimated_starts import estimated_states, start_signal
from compiler.ir.types import Type
from msnn.data.dataset import FloatArray
from msnn.training.engines.dropout_masks import with_all_kept
from msnn.training.plans.stage_plan import StagePlan


def own_series(plan: StagePlan, series: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The series with those that change as arrays of their own, before anything is drawn or found.

    Every factor of dropout is 1 and every run starts from 0.
    """
    rows = len(next(iter(series.values()), np.zeros(0)))
    states = () if plan.rollout.starts is None else estimated_states(plan.rollout.starts.program)
    blank = {start_signal(s.name): np.zeros((rows, *Type(s.axes).shape)) for s in states}
    return {**with_all_kept(series, plan.masks), **blank}


def without_masks(plan: StagePlan, series: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The series that are no factors of dropout: what is measured leaves nothing out."""
    masks = {mask.signal for mask in plan.masks}
    return {name: values for name, values in series.items() if name not in masks}
