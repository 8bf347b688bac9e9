"""Finds where runs start: Gauss-Newton on the squares of their first evaluations (decision 0211).

A start x of one run minimises F = Σ cₗ rₗᵀrₗ over its first N evaluations, cₗ weight / count of the
loss l, with the exact slopes J of the residuals r in x.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.differentiation.compared_squares import SIZE_OF, compared_squares
from compiler.differentiation.estimated_starts import (
    estimated_states,
    offset_parameter,
    start_signal,
    with_moved_starts,
)
from compiler.differentiation.residuals import LossResiduals
from compiler.differentiation.sensitivities import sensitivities
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Output, Program
from compiler.ir.types import Type
from msnn.data.dataset import BoolArray, Dataset, FloatArray, IntArray
from msnn.data.starts import Runs
from msnn.errors.learning import fitted_starts as errors
from msnn.simulation.gauss_newton import RunProducts, descended
from msnn.simulation.rollout import moments
from msnn.simulation.rollout_plan import RolloutPlan
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings

Series = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class FoundStarts:
    """The starts of runs, and the doubts about them."""

    t0: IntArray
    values: Mapping[str, FloatArray]
    """(runs, *shape) of each state."""
    undecided: Mapping[str, BoolArray]
    """Runs whose first evaluations do not decide the state: it stays where the search began."""
    unsettled: BoolArray
    """Runs that would move on after the last step."""

    def series(self, rows: int) -> dict[str, FloatArray]:
        """The values in the rows t0, as programs with read starts take them."""
        found: dict[str, FloatArray] = {}
        for name, values in self.values.items():
            # only the rows t0 are ever read
            whole = np.zeros((rows, *values.shape[1:]))
            whole[self.t0] = values
            found[start_signal(name)] = whole
        return found


class StartFit:
    """Finds the starts of one program's runs, its loops closed."""

    def __init__(self, program: Program, over: int | None, skip: int = 0) -> None:
        """`over` evaluations of each run decide; None for all that it has, from `skip` on."""
        self._skip = skip
        self._program = program
        self._over = over
        self._states = estimated_states(program)
        # start + offset with an offset of 0: slopes in the offset are those in the start
        self._moved = compared_squares(with_moved_starts(program))
        self._sizes = [Type(state.axes).size for state in self._states]
        offsets = [offset_parameter(state) for state in self._states]
        self._judged, self._residuals = with_slopes(self._moved, offsets)

    @property
    def signals(self) -> tuple[str, ...]:
        """The series that say where runs start."""
        return tuple(start_signal(state.name) for state in self._states)

    def blank(self, rows: int) -> dict[str, FloatArray]:
        """The starts before anything is found, as series."""
        return {
            start_signal(state.name): np.zeros((rows, *Type(state.axes).shape))
            for state in self._states
        }

    def find(
        self,
        series: Series,
        runs: Runs,
        weights: Series | None,
        loss_weights: Mapping[str, float] | None = None,
        rows: Mapping[str, BoolArray] | None = None,
    ) -> FoundStarts:
        """The starts at these weights; `loss_weights` are those of the spec by default.

        `rows` limits what decides to some rows of each loss.
        """
        if self._over is not None:
            # what comes after does not decide: it need not be run
            runs = replace(runs, steps=np.minimum(runs.steps, self._over))
        shares = {
            loss.name: loss.weight * loss.share if loss_weights is None else loss_weights[loss.name]
            for loss in self._moved.losses
            # sizes compare nothing
            if loss.target is not None
        }
        judge = Interpreter(self._judged, weights)
        # a copy of the mapping, not of the series: `products` writes into its own arrays
        log = {**series, **self.blank(len(next(iter(series.values()))))}

        def products(members: IntArray, values: FloatArray) -> RunProducts:
            some = runs.take(members)
            for name, part in self._parts(values):
                # starts are series that the program reads in the row where a run begins
                log[start_signal(name)][some.t0] = part
            return self._products(judge, log, some, shares, rows)

        begin = Interpreter(self._program, weights).start(series, runs.t0)
        flat = [begin[state.name].reshape(len(runs), -1) for state in self._states]
        # each run by itself: no run's evaluations depend on another's start
        found = descended(np.concatenate(flat, axis=1), products)
        lost = {
            name: np.asarray(part.reshape(len(runs), -1).any(axis=1))
            for name, part in self._parts(found.undecided)
        }
        return FoundStarts(runs.t0, dict(self._parts(found.values)), lost, ~found.settled)

    def _parts(self, numbers: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
        """The numbers of each state out of rows of all of them."""
        parts = np.split(numbers, np.cumsum(self._sizes)[:-1], axis=1)
        for state, part in zip(self._states, parts, strict=True):
            yield state.name, part.reshape(len(numbers), *Type(state.axes).shape)

    def _products(
        self,
        judge: Interpreter,
        log: Series,
        runs: Runs,
        shares: Mapping[str, float],
        rows: Mapping[str, BoolArray] | None,
    ) -> RunProducts:
        members, numbers = len(runs), sum(self._sizes)
        sums = {one.loss.name: _Sums.of_zeros(members, numbers) for one in self._residuals}
        with np.errstate(all="ignore"):  # a run that leaves the numbers takes no step
            for moment in moments(judge, log, runs, losses=False):
                for name, one in sums.items() if moment.number >= self._skip else ():
                    some = (
                        np.ones(len(moment.t), np.bool_) if rows is None else rows[name][moment.t]
                    )
                    one.add(name, moment.values.outputs, moment.members, some)
            return _weighted(sums, shares)


@dataclass(slots=True)
class _Sums:
    """The sums of one loss over its evaluations, for every run."""

    squares: FloatArray
    slope: FloatArray
    curvature: FloatArray
    size: FloatArray
    count: FloatArray

    @classmethod
    def of_zeros(cls, members: int, numbers: int) -> _Sums:
        shapes = ((members,), (members, numbers), (members, numbers, numbers))
        squares, slope, curvature = map(np.zeros, shapes)
        return cls(squares, slope, curvature, np.zeros(members), np.zeros(members))

    def add(
        self, loss: str, values: Mapping[str, FloatArray], members: IntArray, some: BoolArray
    ) -> None:
        """One evaluation of some of these runs."""
        values = {name: value[some] for name, value in values.items()}
        members, runs = members[some], int(some.sum())
        if not runs:  # all of them are in rows that do not decide
            return
        error = values[f"{RESIDUAL}{loss}"].reshape(runs, -1)
        slopes = values[f"{SLOPES}{loss}"].reshape(runs, self.slope.shape[1], -1)
        self.squares[members] += np.sum(error * error, axis=1)
        # each run stands in a moment once, so that no sum is lost by indexing
        self.slope[members] += np.einsum("rne,re->rn", slopes, error)
        self.curvature[members] += slopes @ slopes.transpose(0, 2, 1)
        self.size[members] += values[f"{_SIZE}{loss}"]
        # of evaluations whose target is there; missing ones have residual 0
        self.count[members] += values[f"{COUNT}{loss}"]


RESIDUAL, SLOPES, _SIZE, COUNT = "residual of ", "slopes of ", "size of ", "count of "
"""Before the name of a loss: outputs of the program that is run."""


def with_slopes(moved: Program, names: Sequence[str]) -> tuple[Program, tuple[LossResiduals, ...]]:
    """The program whose outputs are residuals, their slopes in parameters, sizes and counts."""
    found = sensitivities(moved, names)
    outputs: list[Output] = []
    terms = {term.loss.name: term for term in found.losses}
    for one in found.residuals:
        name, term = one.loss.name, terms[one.loss.name]
        assert term.count is not None, "targets can be missing"
        outputs += [
            Output(f"{RESIDUAL}{name}", one.values),
            Output(f"{SLOPES}{name}", one.slopes),
            Output(f"{_SIZE}{name}", terms[f"{SIZE_OF}{name}"].total),
            Output(f"{COUNT}{name}", term.count),
        ]
    program = replace(found.program, outputs=tuple(outputs), losses=(), expected=(), fits=())
    return program, found.residuals


def _weighted(sums: Mapping[str, _Sums], shares: Mapping[str, float]) -> RunProducts:
    """Σ over the losses of weight / count times what each adds; a loss without rows adds 0."""
    found: list[RunProducts] = []
    for name, one in sums.items():
        scored = one.count > 0
        # the inner `where` keeps 0 / 0 from being computed at all
        share = np.where(scored, shares[name] / np.where(scored, one.count, 1.0), 0.0)
        found.append(
            RunProducts(
                share * one.squares,
                share[:, None] * one.slope,
                share[:, None, None] * one.curvature,
                share * one.size,
            )
        )
    return sum(found[1:], found[0])


def fit_of(plan: RolloutPlan) -> StartFit | None:
    """The fit of a plan's starts; None where it has none to find."""
    return None if plan.starts is None else StartFit(plan.starts.program, plan.starts.over)


def with_starts(
    plan: RolloutPlan,
    data: Dataset,
    runs: Runs,
    weights: Series | None,
    wanted_by: str,
    findings: Findings,
) -> Dataset:
    """The data with where the runs of a plan start; what is uncertain goes to `findings`."""
    fit = fit_of(plan)
    if fit is None:
        return data
    found = fit.find(data.series, runs, weights)
    findings.report(*uncertain_starts(found, data, wanted_by))
    return replace(data, series={**data.series, **found.series(data.rows)})


def uncertain_starts(found: FoundStarts, data: Dataset, wanted_by: str) -> list[Diagnostic]:
    """One warning of what nothing decides, one of what was not settled."""
    diagnostics: list[Diagnostic] = []
    lost = {name: one for name, one in found.undecided.items() if one.any()}
    if lost:
        some = np.any([*lost.values()], axis=0)
        place = data.place(int(found.t0[np.argmax(some)]))
        diagnostics.append(errors.undecided_start([*lost], wanted_by, place, int(some.sum())))
    if found.unsettled.any():
        place = data.place(int(found.t0[np.argmax(found.unsettled)]))
        count = int(found.unsettled.sum())
        diagnostics.append(errors.unsettled_start([*found.values], wanted_by, place, count))
    return diagnostics
