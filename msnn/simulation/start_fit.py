"""Estimates initial states of runs by Gauss-Newton over their first steps (decision 0430).

The initial state x of a run minimises F = Σ cₗ rₗᵀrₗ over its first N steps. cₗ is weight / count
of loss l, and the exact Jacobian of the residuals r in x is used.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.differentiation.estimated_starts import (
    estimated_states,
    offset_parameter,
    start_signal,
    with_moved_starts,
)
from compiler.differentiation.training_step import compared_squares
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.ops import Broadcast, Constant
from compiler.ir.program import Graph, NodeId, Program
from compiler.ir.types import Type
from msnn.data.dataset import BoolArray, Dataset, FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.errors.learning import training as errors
from msnn.model.weights.kept_starts import KeptStarts
from msnn.simulation.gauss_newton import RunProducts, decided_directions, descended
from msnn.simulation.rollout_plan import RolloutPlan, score_some
from msnn.simulation.start_products import RunSums, StartProducts
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings

Series = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class TakenStarts:
    """Initial states that a training has saved, for rollouts that begin at rows `t0`."""

    t0: IntArray
    values: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class FoundStarts:
    """The estimated initial states of rollouts, with flags of those that are uncertain."""

    t0: IntArray
    values: Mapping[str, FloatArray]
    """(runs, *shape) per state."""
    undecided: Mapping[str, BoolArray]
    """Mask of undetermined elements per state; they keep the initial guess."""
    unsettled: BoolArray
    """Mask of runs that have not converged."""
    guessed: BoolArray
    """Mask of runs with an undetermined direction at 0 that later steps depend on."""
    over: int | None
    """Number of first steps used for the estimate; None for all scored steps."""
    notes: tuple[Diagnostic, ...] = ()
    """Further notes about the estimate."""
    taken: TakenStarts | None = None
    """Runs with saved initial states, which were not estimated."""

    @classmethod
    def of_none(
        cls, over: int | None, values: Mapping[str, FloatArray], taken: TakenStarts | None
    ) -> FoundStarts:
        """The result for no runs, with the shapes of these values."""
        none = np.zeros(0, np.bool_)
        return cls(
            t0=np.zeros(0, np.int64),
            values={name: one[:0] for name, one in values.items()},
            undecided={},
            unsettled=none,
            guessed=none,
            over=over,
            taken=taken,
        )

    def doubts_of(self, runs: BoolArray) -> FoundStarts:
        """The same states, but flags only for rollouts in the mask `runs`, (runs,)."""
        undecided = {
            name: one & runs.reshape(-1, *[1] * (one.ndim - 1))
            for name, one in self.undecided.items()
        }
        unsettled, guessed = self.unsettled & runs, self.guessed & runs
        return replace(self, undecided=undecided, unsettled=unsettled, guessed=guessed)

    def series(self, rows: int) -> dict[str, FloatArray]:
        """The initial states as series (rows, *shape), which are 0 except in the start rows."""
        found: dict[str, FloatArray] = {}
        for name, values in self.values.items():
            # only the rows t0 are ever read
            whole = np.zeros((rows, *values.shape[1:]))
            whole[self.t0] = values
            if self.taken is not None:
                whole[self.taken.t0] = self.taken.values[name]
            found[start_signal(name)] = whole
        return found


class StartFit:
    """Estimates the initial states of rollouts of one closed-loop program by least squares."""

    def __init__(
        self,
        program: Program,
        over: int | None,
        skip: int = 0,
        *,
        searches: int = 1,
        native: bool = True,
    ) -> None:
        """`over` steps of each run determine the estimate; None for all steps from `skip` on.

        `searches` is the expected number of calls of `find`; without `native`, no kernel is used.
        """
        self._skip = skip
        self._program = program
        self._over = over
        self._states = estimated_states(program)
        # start + offset with an offset of 0: slopes in the offset are those in the start
        self._moved = compared_squares(with_moved_starts(program))
        self._begins_at_zero = {s.name: _is_zero(program.start, s.start) for s in self._states}
        self._sizes = [Type(state.axes).size for state in self._states]
        offsets = {start_signal(state.name): offset_parameter(state) for state in self._states}
        self._runs = StartProducts(self._moved, offsets, repeats=searches, native=native)

    @property
    def signals(self) -> tuple[str, ...]:
        """The series from which runs read their initial states."""
        return tuple(start_signal(state.name) for state in self._states)

    def blank(self, rows: int) -> dict[str, FloatArray]:
        """The series of initial states filled with 0."""
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
        """Estimates the initial states of rollouts at these weights.

        `series` are the data, (rows, *shape) by signal. `loss_weights` are by default those of the
        spec. `rows` limits each loss to a mask (rows,).
        """
        whole = runs
        if self._over is not None:
            # what comes after does not decide: it need not be run
            runs = replace(runs, steps=np.minimum(runs.steps, self._over))
        shares = {
            loss.name: loss.weight * loss.share if loss_weights is None else loss_weights[loss.name]
            for loss in self._moved.losses
            # sizes compare nothing
            if loss.target is not None
        }
        # a copy of the mapping, not of the series: `products` writes into its own arrays
        log = {**series, **self.blank(len(next(iter(series.values()))))}
        each = self._runs.on(log, runs, weights, self._skip, rows)

        def products(members: IntArray, values: FloatArray) -> RunProducts:
            some = runs.take(members)
            for name, part in self._parts(values):
                # starts are series that the program reads in the row where a run begins
                log[start_signal(name)][some.t0] = part
            with np.errstate(all="ignore"):  # a run that leaves the numbers takes no step
                return _weighted(each(some), shares)

        begin = Interpreter(self._program, weights).start(series, runs.t0)
        flat = [begin[state.name].reshape(len(runs), -1) for state in self._states]
        # each run by itself: no run's evaluations depend on another's start
        found = descended(np.concatenate(flat, axis=1), products)
        lost = {
            name: np.asarray(part.reshape(len(runs), -1).any(axis=1))
            for name, part in self._parts(found.undecided)
        }
        values = dict(self._parts(found.values))
        guessed = np.zeros(len(runs), np.bool_)
        for name, part in self._parts(found.undecided):
            if self._begins_at_zero[name]:
                guessed |= part.reshape(len(runs), -1).any(axis=1)
        if self._over is not None and guessed.any():
            some = np.flatnonzero(guessed)
            first, later = (
                decided_directions(_weighted(each(one.take(some)), shares).curvature)
                for one in (runs, whole)
            )
            guessed[some] = later > first
        elif self._over is None:
            guessed[:] = False
        return FoundStarts(
            t0=runs.t0,
            values=values,
            undecided=lost,
            unsettled=~found.settled,
            guessed=guessed,
            over=self._over,
            notes=self._runs.notes,
        )

    def find_or_take(
        self,
        data: Dataset,
        runs: Runs,
        weights: Series | None,
        rows: Mapping[str, BoolArray] | None = None,
        kept: KeptStarts | None = None,
    ) -> FoundStarts:
        """The saved initial states in `kept`; estimates as in `find` for all other runs."""
        if kept is None or not kept.is_of({s.name: Type(s.axes).shape for s in self._states}):
            return self.find(data.series, runs, weights, rows=rows)
        known, values = kept.at(data, runs.t0)
        taken = TakenStarts(runs.t0[known], {name: one[known] for name, one in values.items()})
        others = runs.take(np.flatnonzero(~known))
        if not len(others):
            return FoundStarts.of_none(self._over, values, taken)
        return replace(self.find(data.series, others, weights, rows=rows), taken=taken)

    def _parts(self, numbers: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
        """Splits (runs, elements) into the values of each state."""
        parts = np.split(numbers, np.cumsum(self._sizes)[:-1], axis=1)
        for state, part in zip(self._states, parts, strict=True):
            yield state.name, part.reshape(len(numbers), *Type(state.axes).shape)


def _weighted(sums: Mapping[str, RunSums], shares: Mapping[str, float]) -> RunProducts:
    """The total over losses, for each rollout: Σ weight / count times the sums of a loss.

    A loss without scored rows adds 0.
    """
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


def _is_zero(graph: Graph, place: NodeId) -> bool:
    """True if a value is the constant 0, the initial guess if the spec gives none."""
    node = graph[place]
    if isinstance(node.op, Constant):
        return not any(node.op.values)
    return isinstance(node.op, Broadcast) and _is_zero(graph, node.args[0])


def fit_of(plan: RolloutPlan, *, searches: int = 1, native: bool = True) -> StartFit | None:
    """The estimator for a plan; None if all its initial states are defined by the spec."""
    starts = plan.starts
    if starts is None:
        return None
    first = starts.first_to_decide
    return StartFit(starts.program, starts.over, first, searches=searches, native=native)


def with_starts(
    plan: RolloutPlan,
    data: Dataset,
    runs: Runs,
    weights: Series | None,
    wanted_by: str,
    findings: Findings,
    *,
    rows: Mapping[str, BoolArray] | None = None,
    kept: KeptStarts | None = None,
) -> tuple[RolloutPlan, Dataset]:
    """The plan and the data to which estimated initial states of `runs` are added as series.

    Warnings about uncertain estimates go to `findings`. If all runs have saved initial states in
    `kept`, the plan scores every row that the training scored. `rows` are masks of scored rows per
    loss.
    """
    fit = fit_of(plan)
    if fit is None or plan.starts is None:
        return plan, data
    scored = rows if plan.starts.over is None else None
    found = fit.find_or_take(data, runs, weights, scored, kept)
    # runs through whole records are runs through those of other sets too: they score nothing
    searched = np.isin(found.t0, runs.t0[score_some(runs, rows)])
    findings.report(*uncertain_starts(found.doubts_of(searched), data, wanted_by))
    if not searched.any():
        starts = replace(plan.starts, as_trained=True)
        plan = replace(plan, starts=starts, skip=starts.skip)
    return plan, replace(data, series={**data.series, **found.series(data.rows)})


def uncertain_starts(found: FoundStarts, data: Dataset, wanted_by: str) -> list[Diagnostic]:
    """Warnings about undetermined initial states, and about estimates that did not converge."""
    diagnostics = [*found.notes]
    lost = {name: one for name, one in found.undecided.items() if one.any()}
    if found.over is not None and found.guessed.any():
        place = data.place(int(found.t0[np.argmax(found.guessed)]))
        names = [name for name, one in lost.items() if (one & found.guessed).any()]
        count = int(found.guessed.sum())
        diagnostics.append(errors.guessed_start(names, wanted_by, place, count, found.over))
    elif lost:
        some = np.any([*lost.values()], axis=0)
        place = data.place(int(found.t0[np.argmax(some)]))
        diagnostics.append(
            errors.undecided_start([*lost], wanted_by, place, int(some.sum()), found.over)
        )
    if found.unsettled.any():
        place = data.place(int(found.t0[np.argmax(found.unsettled)]))
        count = int(found.unsettled.sum())
        diagnostics.append(errors.unsettled_start([*found.values], wanted_by, place, count))
    return diagnostics
