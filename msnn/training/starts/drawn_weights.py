"""Draws the initial weights of further attempts at a stage."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.model.weights.weights_file import initial_weights
from msnn.training.plans.stage_plan import StagePlan

Weights = Mapping[str, FloatArray]
Draws = Callable[[int], Weights]
"""Returns random initial values by number."""


def drawn_weights(
    program: Program, plan: StagePlan, weights: Weights, redrawn: Draws | None, attempt: int
) -> Weights:
    """The initial weights of an attempt: trained parameters at initial values are drawn again."""
    if attempt == 0 or redrawn is None:
        return weights
    initial, drawn = initial_weights(program), redrawn(attempt)
    return {
        name: drawn[name]
        if name in plan.trained and np.array_equal(value, initial[name])
        else value
        for name, value in weights.items()
    }


def begins_alike(
    program: Program, plan: StagePlan, weights: Weights, redrawn: Draws | None
) -> bool:
    """True if all of several attempts at a stage are identical."""
    if plan.attempts == 1 or plan.masks:
        return False
    second = drawn_weights(program, plan, weights, redrawn, 1)
    return all(np.array_equal(second[name], weights[name]) for name in plan.trained)
