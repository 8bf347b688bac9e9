"""Compares an exported moving-horizon estimator with the one in Python, along drawn samples.

Both stop where no optimality condition is off by more than the tolerance τ. The cost of a window
has a curvature of 2 at least in each number of its whitened noise, so that the noise is off by τ/2
at most in each; with gaps of τ by the scales of the states at each of N+2 stages an estimate is off
by (N+2) τ (scale + largest standard deviation). The same is left of how arrival filters differ,
whose slopes are those at the estimates.

A window that one of them stops early (CAPPED) is off by its residual instead of τ. Where none is
solved the two are one filter, which is held to rounding.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from msnn.agreement.agreement import Agreement
from msnn.agreement.judging.judgement import FloatType
from msnn.exports.target import Weights
from msnn.features.control.backend.constants import reachable
from msnn.features.control.backend.estimation.golden_filter import golden_steps
from msnn.features.control.backend.estimation.library import FilterLibrary
from msnn.features.control.export.estimate_share import EstimateShare
from msnn.features.control.kalman.estimate import FilterStatus
from msnn.features.control.problem.state_estimation.problem import EstimationProblem
from msnn.features.control.run.estimation.moving_horizon import MovingHorizon
from msnn.features.control.run.reference_method import ReferenceMethod

_SEEDS = (0, 1)
"""Of runs; the first is that of the self-test."""


def compare_horizon(
    problem: EstimationProblem, weights: Weights, folder: Path, dtype: FloatType, target: str
) -> Agreement:
    """Estimates along drawn samples, in a folder with the built `controller.so`.

    `one_step` is the largest deviation of an estimate or of its standard deviation, by the largest
    magnitude of each estimate; samples follow each other, so that `free_run` is the same.
    """
    library = FilterLibrary.of_folder(folder, folder / "controller.so")
    judge = MovingHorizon(problem, weights, ReferenceMethod)
    # what float32 can reach, where the spec asks for less
    tolerance = reachable(judge.control.tolerance, dtype)
    scales = np.concatenate(
        [np.full(m.size, judge.control.state_scales[m.name]) for m in judge.numbers.members]
    )
    share, compared, has_failed = EstimateShare(), 0, False
    for seed in _SEEDS:
        golden = golden_steps(problem, weights, dtype, seed)
        library.reset(golden.start)
        judge.reset(_named(judge, golden.start))
        largest = np.array(golden.largest)
        stages = judge.control.horizon + 1
        most_std = np.max(golden.largest_std, initial=0.0)
        for step in golden.steps:
            measured, given = _numbers(problem, step.measured, step.given)
            expected = judge.correct(measured, given)
            found = library.correct_numbers(step.measured, step.given)
            # a window that neither can solve is no fault of the export
            has_failed |= found.status >= FilterStatus.DIVERGED > expected.status
            has_failed |= found.status == FilterStatus.CAPPED and not np.isfinite(found.residual)
            share.count()
            near = np.array(golden.near)
            pairs = [(found.std, np.array(step.std), np.array(golden.near_std))]
            if max(found.status, expected.status) <= FilterStatus.CAPPED:
                stopped = [one.residual for one in (found, expected) if one.status]
                # both are off from the optimum, each by no more than the larger residual
                left = max(tolerance, *stopped) if stopped else tolerance
                pairs.append((found.x, judge.vector, near + stages * left * (scales + most_std)))
                compared += 1
            # neither solved the window: both fall back to the filter, which has nothing to iterate
            elif found.status == expected.status:
                pairs.append((found.x, judge.vector, near))
            for values, expected_values, bound in pairs:
                share.compare(values, expected_values, bound, largest)
            # both go on from their own estimates: differences may grow along the run, and are
            # bounded anew
            judge.predict(given)
            library.predict_numbers(step.given)
    return share.agreement(
        target=target,
        dtype=dtype,
        has_failed=has_failed,
        selftest=library.selftest(),
        tested="estimator",
        untried=() if compared else ("the window, of which none was solved",),
    )


def _named(judge: MovingHorizon, start: tuple[float, ...]) -> dict[str, np.ndarray]:
    numbers = np.array(start)
    members = [m for m in judge.numbers.members if m.name not in judge.problem.parameters]
    return {
        m.name: numbers[m.first : m.first + m.size].reshape([axis.size for axis in m.axes])
        for m in members
    }


def _numbers(
    problem: EstimationProblem, measured: tuple[float, ...], given: tuple[float, ...]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Numbers one after the other as arrays by name."""
    graph, program = problem.program.step, problem.program
    shapes = [(m.signal, graph[program.output(m.value).node].type.shape) for m in problem.measured]
    inputs = [(m.name, tuple(axis.size for axis in m.axes)) for m in problem.inputs.members]
    return _split(measured, shapes), _split(given, inputs)


def _split(
    numbers: tuple[float, ...], shapes: list[tuple[str, tuple[int, ...]]]
) -> dict[str, np.ndarray]:
    rest = np.array(numbers)
    found: dict[str, np.ndarray] = {}
    for name, shape in shapes:
        size = int(np.prod(shape, dtype=int))
        found[name], rest = rest[:size].reshape(shape), rest[size:]
    return found
