"""Judges an exported filter by the filter in Python, along drawn samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from backends.predictive_control.estimation.golden_filter import golden_steps
from backends.predictive_control.estimation.library import FilterLibrary
from compiler.state_estimation.problem import EstimationProblem
from msnn.agreement.agreement import Agreement
from msnn.agreement.faults import FarStep, Fault, SelfTestFails
from msnn.agreement.judgement import FloatType
from msnn.exports.target import Weights

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
    worst, allowed, count = 0.0, 0.0, 0
    share = 0.0
    wrong_status = False
    for seed in _SEEDS:
        golden = golden_steps(problem, weights, dtype, seed)
        library.reset(golden.start)
        for step in golden.steps:
            found = library.correct_numbers(step.measured, step.given)
            wrong_status |= found.status != step.corrected
            wrong_status |= library.predict_numbers(step.given) != step.predicted
            count += 1
            for values, expected, near, largest in (
                (found.x, step.x, golden.near, golden.largest),
                (found.std, step.std, golden.near_std, golden.largest_std),
            ):
                off = np.abs(values.astype(float) - np.array(expected))
                shares = _part(off, np.array(near))
                most = int(np.argmax(shares)) if shares.size else 0
                if shares.size and not shares[most] <= share:
                    size = max(largest[most], np.finfo(float).tiny)
                    share = float(shares[most])
                    worst, allowed = float(off[most]) / size, near[most] / size
    faults: tuple[Fault, ...] = ()
    if wrong_status or not share <= 1:
        faults = (FarStep("the estimate", worst, allowed),)
    if bits := library.selftest():
        faults = (*faults, SelfTestFails("the self-test of the filter", bits))
    return Agreement(
        target=target,
        dtype=dtype,
        steps=count,
        one_step=worst,
        free_run=worst,
        jacobian=None,
        bits=None,
        faults=faults,
        undecided={},
        untried=(),
        rounding={},
    )


def joined(found: Sequence[Agreement]) -> Agreement:
    """One row of a controller, its filter and their units: the larger of each number."""
    first, *rest = found
    for other in rest:
        first = replace(
            first,
            steps=first.steps + other.steps,
            one_step=float(np.maximum(first.one_step or 0.0, other.one_step or 0.0)),
            free_run=float(np.maximum(first.free_run, other.free_run)),
            bits=_sum(first.bits, other.bits),
            faults=(*first.faults, *other.faults),
            untried=(*first.untried, *other.untried),
        )
    return first


def _sum(one: int | None, other: int | None) -> int | None:
    return other if one is None else one + (other or 0)


def _part(off: NDArray[np.float64], near: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of what is allowed; 0 where nothing is off."""
    with np.errstate(all="ignore"):
        return np.where(off == 0, 0.0, off / near)
