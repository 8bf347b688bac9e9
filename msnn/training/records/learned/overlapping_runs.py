"""Sums how noise affects the gradient if several runs read the same measured value.

Overlapping runs score a value more than once, and a value scored in one run may determine the start
of another. The gradient is s = Σₜ aₜ eₜ over measured values. Here aₜ = Σ cₗ J over the runs that
score it, minus Σ G c̃ₗ K̃ over those whose start it determines (see `held_starts`). Its covariance
is Σ aₜᵀaₜ for noise of variance 1. The sums are over rows of the data, so the reference interpreter
computes them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from backends.gauss_newton_products import Products, StartBlocks
from compiler.differentiation.estimated_starts import (
    estimated_states,
    offset_parameter,
    with_moved_starts,
)
from compiler.differentiation.training_step import compared_squares
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.types import Type
from msnn.data.dataset import BoolArray, Dataset, FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import moments
from msnn.simulation.start_fit import StartFit
from msnn.simulation.start_products import COUNT, RESIDUAL, SLOPES, with_slopes
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.records.learned.held_starts import HeldStarts
from msnn.training.records.learned.information import shares_of

Rows = Mapping[str, BoolArray]


def of_overlapping_runs(
    plan: StagePlan, data: Dataset, rows: Rows | None, runs: Runs, weights: Mapping[str, FloatArray]
) -> HeldStarts:
    """The information of residuals about the parameters, for the runs used in training."""
    each = _Runs.found(plan, data, rows, runs, weights)
    scored = {name: _Sums.of_zeros(len(runs), each.learned, each.starts) for name in each.losses}
    first = {name: _Sums.of_zeros(len(runs), each.learned, each.starts) for name in each.losses}
    for one in each.slopes():
        (first if one.decides else scored)[one.loss].add(one)
    products = {name: one.products() for name, one in scored.items()}
    shares = shares_of(plan, products)
    # a run whose first rows are all missing decides nothing: its products are 0
    decided = {
        name: plan.loss_weights[name] / np.maximum(first[name].count, 1.0) for name in shares
    }
    found = HeldStarts.of_blocks(
        products, shares, {name: first[name].blocks() for name in shares}, decided
    )
    reached: dict[str, FloatArray] = {}
    # a second pass: G of a run takes the sums of the first one
    for one in (one for one in each.slopes() if one.loss in shares):
        j, k = one.slopes[:, : each.learned], one.slopes[:, each.learned :]
        # (rows, learned, elements): what all runs say of a row adds up before it is squared
        sums = reached.setdefault(one.loss, np.zeros((data.rows, each.learned, j.shape[2])))
        if one.decides:
            noise = decided[one.loss][one.members, None, None] * k
            sums[one.t] -= found.carried[one.members] @ noise
        else:
            sums[one.t] += shares[one.loss] * j
    slopes = {name: np.einsum("tpm,tqm->pq", sums, sums) for name, sums in reached.items()}
    return replace(found, slopes=slopes)


@dataclass(slots=True)
class _Sums:
    """The sums of one loss over the steps of all rollouts, to which steps are added one by one."""

    curvature: FloatArray
    cross: FloatArray
    own: FloatArray
    count: FloatArray
    squares: float = 0.0

    @classmethod
    def of_zeros(cls, runs: int, learned: int, starts: int) -> _Sums:
        """The sums before the first step."""
        return cls(
            np.zeros((learned, learned)),
            np.zeros((runs, learned, starts)),
            np.zeros((runs, starts, starts)),
            np.zeros(runs),
        )

    def add(self, one: _Slopes) -> None:
        """Adds the derivatives of one step of some rollouts to the sums."""
        learned = len(self.curvature)
        j, k = one.slopes[:, :learned], one.slopes[:, learned:]
        self.curvature += np.einsum("rpm,rqm->pq", j, j)
        # += with an index adds once where one is repeated: no run is twice among these members
        self.cross[one.members] += j @ k.transpose(0, 2, 1)
        self.own[one.members] += k @ k.transpose(0, 2, 1)
        self.count[one.members] += one.count
        self.squares += float(np.sum(one.error**2))

    def blocks(self) -> StartBlocks:
        """The blocks of initial states; their gradient is not needed and is 0."""
        return StartBlocks(self.cross, self.own, np.zeros(self.own.shape[:2]))

    def products(self) -> Products:
        """The products of the parameters, with separate blocks for initial states."""
        nothing = np.zeros(len(self.curvature))
        count = float(self.count.sum())
        found = Products(
            curvature=self.curvature,
            slope=nothing,
            squares=self.squares,
            cost=self.squares,
            count=count,
        )
        return replace(found, starts=self.blocks())


@dataclass(frozen=True, slots=True, kw_only=True)
class _Slopes:
    """The derivatives of one loss's residuals at one step of some rollouts (`members`)."""

    loss: str
    members: IntArray
    t: IntArray
    decides: bool
    """True if these rows determine the initial states of their runs; else they are scored."""
    error: FloatArray
    slopes: FloatArray
    """(runs, learned elements and elements of x, residuals)."""
    count: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Runs:
    """Runs whose first rows determine their initial states."""

    judge: Interpreter
    log: Mapping[str, FloatArray]
    runs: Runs
    rows: Rows | None
    losses: tuple[str, ...]
    learned: int
    starts: int
    over: int
    skip: int

    @classmethod
    def found(
        cls,
        plan: StagePlan,
        data: Dataset,
        rows: Rows | None,
        runs: Runs,
        weights: Mapping[str, FloatArray],
    ) -> _Runs:
        starts = plan.rollout.starts
        assert starts is not None
        assert starts.over is not None, "later rows are scored"
        found = StartFit(starts.program, starts.over).find(
            data.series, runs, weights, plan.loss_weights
        )
        states = estimated_states(starts.program)
        offsets = [offset_parameter(state) for state in states]
        moved = compared_squares(with_moved_starts(starts.program))
        program, residuals = with_slopes(moved, [*plan.trained, *offsets])
        return cls(
            judge=Interpreter(program, weights),
            log={**data.series, **found.series(data.rows)},
            runs=runs,
            rows=rows,
            losses=tuple(one.loss.name for one in residuals),
            learned=sum(weights[name].size for name in plan.trained),
            starts=sum(Type(state.axes).size for state in states),
            over=starts.over,
            skip=plan.rollout.skip,
        )

    def slopes(self) -> Iterator[_Slopes]:
        """Yields the derivatives of every loss, step by step along the rollouts."""
        with np.errstate(all="ignore"):  # as in training, a run that leaves the numbers is told of
            for moment in moments(self.judge, self.log, self.runs, losses=False):
                decides = moment.number < self.over
                for name in self.losses if decides or moment.number >= self.skip else ():
                    # all known rows decide a start; those of the set alone are scored
                    some = np.ones(len(moment.t), np.bool_)
                    if self.rows is not None and not decides:
                        some = self.rows[name][moment.t]
                    count = moment.values.outputs[f"{COUNT}{name}"][some]
                    slopes = moment.values.outputs[f"{SLOPES}{name}"][some]
                    shape = (len(count), self.learned + self.starts, -1)
                    if len(count):
                        yield _Slopes(
                            loss=name,
                            members=moment.members[some],
                            t=moment.t[some],
                            decides=decides,
                            error=moment.values.outputs[f"{RESIDUAL}{name}"][some],
                            slopes=slopes.reshape(shape),
                            count=count,
                        )
