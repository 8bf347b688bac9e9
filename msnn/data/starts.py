"""Finds the start rows of rollouts, such that all rows they read are in one episode (R2)."""

from __future__ import annotations

from dataclasses import field
from typing import Literal

import numpy as np

from compiler.ir.nodes import Extent
from compiler.ir.program import Program
from msnn.data.dataset import IntArray
from msnn.data.reads import reads, span
from spec_schema.late_dataclass import dataclass

Horizon = int | Literal["episode", "record"]
"""Steps per rollout; `record` simulates all rows of a recording and scores those of a set."""


@dataclass(frozen=True, slots=True)
class Reach:
    """Rows relative to t that a step reads from the data, and rows after t0 that the start
    reads.
    """

    back: int
    ahead: int
    start_ahead: int

    def rows(self, steps: int) -> int:
        """Number of rows that a rollout of `steps` steps needs."""
        # R2: rows t0 − A … max(t0 + N − 1 + B, t0 + B0)
        return self.back + max(steps + self.ahead, self.start_ahead + 1)


@dataclass(frozen=True, slots=True)
class Runs:
    """Rollouts that run in parallel: `steps[i]` evaluations from row `t0[i]`."""

    t0: IntArray
    steps: IntArray
    skipped: int
    """Number of episodes that are too short for one rollout."""
    longest: int
    """Rows of the longest episode."""
    uniform: bool = field(init=False, repr=False, compare=False)
    """True if all rollouts have the same number of steps."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "uniform", not np.any(self.steps != self.steps[:1]))

    def __len__(self) -> int:
        return len(self.t0)

    def begin_as(self, other: Runs) -> bool:
        """True if both are the same rollouts in the same order."""
        return np.array_equal(self.t0, other.t0) and np.array_equal(self.steps, other.steps)

    def take(self, members: IntArray) -> Runs:
        return Runs(self.t0[members], self.steps[members], self.skipped, self.longest)


def reach(program: Program, also: Extent | None = None) -> Reach:
    """The samples relative to t that the step, losses, `predicts` and the start of a program read.

    `also` are further samples to include, such as the target of a metric.
    """
    wanted = [output.node for output in program.outputs]
    wanted += [state.next for state in program.states]
    wanted += [node for loss in program.losses for node in loss.nodes]
    around = span(reads(program.step, wanted).values()) or Extent(0, 0)
    for output in program.outputs:
        if output.predicts is not None:
            # a prediction is compared with the data, so its row must exist
            around = around.union(Extent(0, output.predicts.ahead))
    if also is not None:
        around = around.union(also)
    starts = reads(program.start, [state.start for state in program.states])
    start = span(starts.values()) or Extent(0, 0)
    # R2: A := max(A, A0)
    back = max(-around.first, -start.first, 0)
    return Reach(back, max(around.last, 0), max(start.last, 0))


def rollouts(
    episodes: IntArray, reach: Reach, horizon: Horizon, stride: int, *, rest: bool = False
) -> Runs:
    """All rollouts in the episodes (start, stop), in order; the cost is linear in their number.

    With `rest`, a last, shorter rollout covers the samples that no full rollout reaches; this
    requires `stride` = horizon.
    """
    lengths = episodes[:, 1] - episodes[:, 0]
    longest = int(lengths.max(initial=0))
    # R2: T − A − B one-step samples of an episode of T rows
    samples = np.maximum(lengths - reach.back - reach.ahead, 0)
    # the start may look farther ahead than the steps do
    starts = np.clip(lengths - reach.back - reach.start_ahead, 0, samples)
    first = episodes[:, 0] + reach.back
    if isinstance(horizon, str):
        fits = starts > 0
        return Runs(first[fits], samples[fits], int(np.sum(~fits)), longest)
    full = np.where(samples >= horizon, (samples - horizon) // stride + 1, 0)
    # ⌈starts / stride⌉: so many of t0 = 0, stride, … are among the rows that the start can read
    full = np.minimum(full, -(-starts // stride))
    count = full
    if rest:
        left = samples - full * stride
        count = full + ((left > 0) & (full * stride < starts))
    which = np.repeat(np.arange(len(episodes)), count)
    # 0, 1, … within each episode, without a loop over episodes
    number = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    t0 = first[which] + number * stride
    # the last one with `rest` is shorter
    steps = np.minimum(horizon, first[which] + samples[which] - t0)
    return Runs(t0, steps, int(np.sum(count == 0)), longest)
