"""Draws dropout factors, one series per mask, with a counter-based generator: reproducible."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from compiler.passes.draw_dropout import Mask
from msnn.data.dataset import FloatArray
from msnn.training.plans.stage_plan import StagePlan


def with_all_kept(series: Mapping[str, FloatArray], masks: Sequence[Mask]) -> dict[str, FloatArray]:
    """The series with all dropout factors set to 1."""
    rows = len(next(iter(series.values()), np.zeros(0)))
    return {**series, **{mask.signal: np.ones((rows, mask.size)) for mask in masks}}


def factors_of(
    plan: StagePlan, series: Mapping[str, FloatArray], epoch: int, attempt: int = 0
) -> dict[str, FloatArray]:
    """The dropout factors of an epoch for all rows: (rows, elements) per mask.

    The generator is Philox (Salmon et al. 2011), keyed by seed, stage, epoch, attempt and mask. A
    step at row t uses the factors of row t, in any rollout.
    """
    found: dict[str, FloatArray] = {}
    rows = len(next(iter(series.values()), np.zeros(0)))
    for number, mask in enumerate(plan.masks):
        key = np.random.SeedSequence([plan.seed, plan.index, epoch, attempt, number])
        source = np.random.Philox(key)
        draws = np.random.Generator(source).random((rows, mask.size))
        found[mask.signal] = np.where(draws < mask.rate, 0.0, 1.0 / (1.0 - mask.rate))
    return found
