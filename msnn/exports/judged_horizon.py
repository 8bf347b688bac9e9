"""Judges an exported moving-horizon estimator by the one in Python, along drawn samples.

Both stop where no optimality condition is off by more than the tolerance τ. The cost of a window
has a curvature of 2 at least in each number of its whitened noise, so that the noise is off by τ/2
at most in each; with gaps of τ by the scales of the states at each of N+2 stages an estimate is off
by (N+2) τ (scale + largest standard deviation). The same is left of how arrival filters differ,
whose slopes are those at the estimates.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from backends.predictive_control.constants import reachable
from backends.predictive_control.estimation.golden_filter import golden_steps
from backends.predictive_control.estimation.library import FilterLibrary
from compiler.state_estimation.estimate import FilterStatus
from compiler.state_estimation.problem import EstimationProblem
from msnn.agreement.agreement import Agreement
from msnn.agreement.faults import FarStep, Fault, SelfTestFails
from msnn.agreement.judgement import FloatType
from msnn.control.estimation.moving_horizon import MovingHorizon
from msnn.control.reference_method import ReferenceMethod
from msnn.exports.target import Weights

_SEEDS = (0, 1)
"""Of runs; the first is that of the self-test."""


def compare_horizon(
    problem: EstimationProblem, weights: Weights, folder: Path, dtype: FloatType, target: str
) -> Agreement:
    """Estimates along drawn samples, in a folder with the built `controller.so`.

    `one_step` is the largest deviation of an estimate, by the largest magnitude of each; samples
    follow each other, so that `free_run` is the same. A window that one of them does not solve to
    the tolerance is not compared: the judge of a solve is its residual.
    """
    library = FilterLibrary.of_folder(folder, folder / "controller.so")
    judge = MovingHorizon(problem, weights, ReferenceMethod)
    tolerance = reachable(judge.control.tolerance, dtype)
    scales = np.concatenate(
        [np.full(m.size, judge.control.state_scales[m.name]) for m in judge.numbers.members]
    )
    worst, allowed, share, count = 0.0, 0.0, 0.0, 0
    has_failed = False
    for seed in _SEEDS:
        golden = golden_steps(problem, weights, dtype, seed)
        library.reset(golden.start)
        judge.reset(_named(judge, golden.start))
        largest = np.maximum(np.array(golden.largest), np.finfo(float).tiny)
        stages = judge.control.horizon + 1
        rounding = np.array(golden.near)
        near = rounding + stages * tolerance * (scales + np.max(golden.largest_std, initial=0.0))
        for step in golden.steps:
            measured, given = _numbers(problem, step.measured, step.given)
            expected = judge.correct(measured, given)
            found = library.correct_numbers(step.measured, step.given)
            has_failed |= found.status >= FilterStatus.DIVERGED > expected.status
            count += 1
            if found.status == expected.status == FilterStatus.FILTERED:
                off = np.abs(found.x.astype(float) - judge.vector)
                most = int(np.argmax(off / near))
                if not off[most] / near[most] <= share:
                    share = float(off[most] / near[most])
                    worst, allowed = float(off[most] / largest[most]), near[most] / largest[most]
            judge.predict(given)
            library.predict_numbers(step.given)
    faults: tuple[Fault, ...] = ()
    if has_failed or not share <= 1:
        faults = (FarStep("the estimate", worst, allowed),)
    if bits := library.selftest():
        faults = (*faults, SelfTestFails("the self-test of the estimator", bits))
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
