"""Checks exported filters and moving-horizon estimators against those in Python."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msnn.agreement.agreement import Agreement, FarStep, Fault, SelfTestFails
from msnn.agreement.judgement import FloatType
from msnn.exports.target import Weights
from msnn.features.control.backend.constants import reachable
from msnn.features.control.backend.golden_filter import golden_steps
from msnn.features.control.backend.library import FilterLibrary
from msnn.features.control.kalman_filter import FilterStatus
from msnn.features.control.problem.state_estimation import EstimationProblem
from msnn.features.control.run.moving_horizon import MovingHorizon
from msnn.features.control.run.reference_method import ReferenceMethod

Array = NDArray[np.float64]


class EstimateShare:
    """The largest error of estimates so far, as a fraction of the allowed one; NaN counts as larger
    than any number, and stays.
    """

    def __init__(self) -> None:
        self._share, self._worst, self._allowed = 0.0, 0.0, 0.0
        self._steps = 0

    def count(self) -> None:
        """Counts a step."""
        self._steps += 1

    def compare(self, found: Array, expected: Array, near: Array, largest: Array) -> None:
        """Compares estimates with `expected`, whose elements may differ by `near`. Errors are
        reported relative to `largest`, the largest magnitude of each element.
        """
        off = np.abs(found.astype(float) - expected)
        with np.errstate(all="ignore"):
            # of a number that may not be off at all every difference is too much
            parts = np.where(off == 0, 0.0, off / near)
        if parts.size == 0 or np.isnan(self._share):
            return
        most = int(np.argmax(parts))
        # written so that NaN counts as larger: argmax finds it first as well
        if not parts[most] <= self._share:
            # an estimate that is 0 all along has no magnitude to compare with
            size = max(float(largest[most]), float(np.finfo(float).tiny))
            self._share = float(parts[most])
            self._worst, self._allowed = float(off[most]) / size, float(near[most]) / size

    def agreement(
        self,
        *,
        target: str,
        dtype: FloatType,
        has_failed: bool,
        selftest: int,
        tested: str,
        untried: tuple[str, ...] = (),
    ) -> Agreement:
        """The result for a table of exports: `one_step` and `free_run` are both the largest error,
        as steps follow each other.

        `has_failed` adds a fault, such as for a wrong status. `selftest` is the bit mask of the
        self-test of the part `tested`; parts in `untried` could not be compared.
        """
        faults: tuple[Fault, ...] = ()
        if has_failed or not self._share <= 1:
            faults = (FarStep("the estimate", self._worst, self._allowed),)
        if selftest:
            faults = (*faults, SelfTestFails(f"the self-test of the {tested}", selftest))
        return Agreement(
            target=target,
            dtype=dtype,
            steps=self._steps,
            one_step=self._worst,
            free_run=self._worst,
            jacobian=None,
            bits=None,
            faults=faults,
            undecided={},
            untried=untried,
            rounding={},
        )


_FILTER_SEEDS = (0, 1, 2, 3)
"""Of runs; the first is that of the self-test."""


def compare_filter(
    problem: EstimationProblem, weights: Weights, folder: Path, dtype: FloatType, target: str
) -> Agreement:
    """Compares an exported filter with the one in Python for random samples. `folder` contains its
    description and the built `controller.so`.

    The error is the largest one of an estimate or of its standard deviation, relative to the
    largest magnitude of each.
    """
    library = FilterLibrary.of_folder(folder, folder / "controller.so")
    share, wrong_status = EstimateShare(), False
    for seed in _FILTER_SEEDS:
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
    """One result for a controller, its filter and their units: the larger of each error, all
    faults.
    """
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


_HORIZON_SEEDS = (0, 1)
"""Of runs; the first is that of the self-test."""


def compare_horizon(
    problem: EstimationProblem, weights: Weights, folder: Path, dtype: FloatType, target: str
) -> Agreement:
    """Compares an exported moving-horizon estimator with the one in Python for random samples.
    `folder` contains its description and the built `controller.so`.

    The error is the largest one of an estimate or of its standard deviation, relative to the
    largest magnitude of each estimate.
    """
    library = FilterLibrary.of_folder(folder, folder / "controller.so")
    judge = MovingHorizon(problem, weights, ReferenceMethod)
    # what float32 can reach, where the spec asks for less
    tolerance = reachable(judge.control.tolerance, dtype)
    scales = np.concatenate(
        [np.full(m.size, judge.control.state_scales[m.name]) for m in judge.numbers.members]
    )
    share, compared, has_failed = EstimateShare(), 0, False
    for seed in _HORIZON_SEEDS:
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
    """Flat measurements and inputs of one sample as arrays by name."""
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
