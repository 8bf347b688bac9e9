"""Compares an exported filter with the filter in Python, along drawn samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from msnn.agreement.agreement import Agreement
from msnn.agreement.judging.judgement import FloatType
from msnn.exports.target import Weights
from msnn.features.control.backend.estimation.golden_filter import golden_steps
from msnn.features.control.backend.estimation.library import FilterLibrary
from msnn.features.control.export.estimate_share import EstimateShare
from msnn.features.control.problem.state_estimation.problem import EstimationProblem

_SEEDS = (0, 1, 2, 3)
"""Of runs; the first is that of the self-test."""


def compare_filter(
    problem: EstimationProblem, weights: Weights, folder: Path, dtype: FloatType, target: str
) -> Agreement:
    """Filters drawn samples, in a folder with the built `controller.so`.

    `one_step` is the largest deviation of an estimate or of its standard deviation, by the largest
    magnitude of each; steps follow each other, so that `free_run` is the same.
    """
    library = FilterLibrary.of_folder(folder, folder / "controller.so")
    share, wrong_status = EstimateShare(), False
    for seed in _SEEDS:
        golden = golden_steps(problem, weights, dtype, seed)
        # both begin anew: steps of one run follow each other, runs do not
        library.reset(golden.start)
        for step in golden.steps:
            found = library.correct_numbers(step.measured, step.given)
            # a refused correction has to be refused by both
            wrong_status |= found.status != step.corrected
            wrong_status |= library.predict_numbers(step.given) != step.predicted
            share.count()
            for values, expected, near, largest in (
                (found.x, step.x, golden.near, golden.largest),
                (found.std, step.std, golden.near_std, golden.largest_std),
            ):
                share.compare(values, np.array(expected), np.array(near), np.array(largest))
    return share.agreement(
        target=target,
        dtype=dtype,
        has_failed=wrong_status,
        selftest=library.selftest(),
        tested="filter",
    )


def joined(found: Sequence[Agreement]) -> Agreement:
    """One row of a controller, its filter and their units: the larger of each number."""
    first, *rest = found
    for other in rest:
        first = replace(
            first,
            steps=first.steps + other.steps,
            # np.maximum keeps NaN, which `max` may lose
            one_step=float(np.maximum(first.one_step or 0.0, other.one_step or 0.0)),
            free_run=float(np.maximum(first.free_run, other.free_run)),
            bits=_sum(first.bits, other.bits),
            faults=(*first.faults, *other.faults),
            untried=(*first.untried, *other.untried),
        )
    return first


def _sum(one: int | None, other: int | None) -> int | None:
    return other if one is None else one + (other or 0)
