"""Draws the factors of dropout, one series a mask, by a counter: the same ones ever."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from compiler.passes.draw_dropout import Mask
from msnn.data.dataset import FloatArray
from msnn.training.plans.stage_plan import StagePlan


def with_all_kept(series: Mapping[str, FloatArray], masks: Sequence[Mask]) -> dict[str, FloatArray]:
    """The series of a stage before anything is drawn: every factor is 1."""
    rows = len(next(iter(series.values()), np.zeros(0)))
    return {**series, **{mask.signal: np.ones((rows, mask.size)) for mask in masks}}


def factors_of(
    plan: StagePlan, series: Mapping[str, FloatArray], epoch: int, attempt: int = 0
) -> dict[str, FloatArray]:
    """The factors of an epoch for the rows of these series: (rows, elements) a mask.

    Philox (Salmon et al. 2011) keyed by seed, stage, epoch, attempt and mask counts through rows
    and elements: a step at row t takes row t, whichever rollout it belongs to.
    """
    found: dict[str, FloatArray] = {}
    rows = len(next(iter(series.values()), np.zeros(0)))
    for number, mask in enumerate(plan.masks):
        key = np.random.SeedSequence([plan.seed, plan.index, epoch, attempt, number])
        source = np.random.Philox(key)
        draws = np.random.Generator(source).random((rows, mask.size))
        found[mask.signal] = np.where(draws < mask.rate, 0.0, 1.0 / (1.0 - mask.rate))
    return found
