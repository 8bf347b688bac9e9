"""Finds the rows of rollouts: which they read, where they may start, and which are scored (R2)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field
from typing import Literal

import numpy as np

from compiler.ir.nodes import Extent, needed
from compiler.ir.ops import ReadLog, ReadSignal
from compiler.ir.program import Graph, Loss, NodeId, Program, Role, Signal
from msnn.data.dataset import BoolArray, Dataset, IntArray
from spec_schema.late_dataclass import dataclass


def reads(graph: Graph, wanted: Iterable[NodeId]) -> dict[str, Extent]:
    """The samples relative to t that the nodes depend on, by signal."""
    marked = needed(graph, wanted)
    found: dict[str, Extent] = {}
    for index, node in graph:
        if not marked[index]:
            continue
        match node.op:
            # in window form both are samples of the log; closing loops takes ReadSignal away
            case ReadLog(signal, first, last) | ReadSignal(signal, first, last):
                extent = Extent(first, last)
                found[signal] = found[signal].union(extent) if signal in found else extent
            case _:
                pass
    return found


def compared_signals(program: Program) -> frozenset[str]:
    """Signals that predictions are compared with, one row at a time, and all targets."""
    targets = {signal.name for signal in program.signals if signal.role is Role.TARGET}
    compared = {o.predicts.signal for o in program.outputs if o.predicts is not None} | targets
    return frozenset(compared.union(*_sides(program)))


def signals_only_compared(program: Program) -> frozenset[str]:
    """The `compared_signals` that no step reads; only their measured values are needed.

    A loss that reads several rows of a signal, e.g. for a derivative, needs interpolated values
    too, and so does an initial state. A target may be read at one row only.
    """
    targets = {signal.name for signal in program.signals if signal.role is Role.TARGET}
    nodes = [output.node for output in program.outputs]
    nodes += [state.next for state in program.states]
    nodes += [loss.prediction for loss in program.losses]
    starts = reads(program.start, [state.start for state in program.states])
    needed = reads(program.step, nodes).keys() | (starts.keys() - targets)
    sides = (*_sides(program), starts)
    needed |= {n for side in sides for n, at in side.items() if at.first != at.last}
    return compared_signals(program) - needed


def measured_beside(whole: Program, program: Program) -> tuple[Signal, ...]:
    """The signals that outputs of `whole` predict and that a part of it, `program`, does not
    read.
    """
    read = {signal.name for signal in program.signals}
    predicted = {out.predicts.signal for out in whole.outputs if out.predicts is not None}
    return tuple(s for s in whole.signals if s.name in predicted - read)


def _sides(program: Program) -> list[dict[str, Extent]]:
    """The samples relative to t that the target of each loss reads."""
    return [
        reads(program.step, [loss.target]) for loss in program.losses if loss.target is not None
    ]


def span(extents: Iterable[Extent]) -> Extent | None:
    """The smallest extent that contains all extents; None if there are none."""
    extents = tuple(extents)
    if not extents:
        return None
    return Extent(min(e.first for e in extents), max(e.last for e in extents))


def rows_that_count(
    dataset: Dataset,
    name: str | None,
    extent: Extent,
    skip_rows: int = 0,
    measured: Iterable[BoolArray] = (),
) -> BoolArray:
    """Mask of rows t for which all rows t+first … t+last belong to the set (None: any set).

    The first `skip_rows` rows of each recording are excluded, and rows that are false in one of the
    `measured` masks.
    """
    member = np.ones(dataset.rows, dtype=np.bool_) if name is None else dataset.in_set(name)
    for record in dataset.records if skip_rows else ():
        member[record.start : min(record.start + skip_rows, record.stop)] = False
    for rows in measured:
        member &= rows
    found = np.ones(len(member), dtype=np.bool_)
    # shifted and joined: windows of targets are short, rows are many
    for offset in range(extent.first, extent.last + 1):
        shifted = np.zeros(len(member), dtype=np.bool_)
        source = member[max(offset, 0) : len(member) + min(offset, 0)]
        shifted[max(-offset, 0) : max(-offset, 0) + len(source)] = source
        found &= shifted
    return found


def scored_rows(
    dataset: Dataset, name: str | None, program: Program, skip_rows: int = 0
) -> Mapping[str, BoolArray]:
    """For every loss of the program, the mask of rows t at which its target counts."""
    return {
        loss.name: rows_that_count(
            dataset,
            name,
            target_extent(program.step, loss),
            skip_rows,
            (dataset.measured[signal] for signal in _lacking(dataset, program.step, loss)),
        )
        for loss in program.losses
    }


def has_unmeasured(dataset: Dataset, program: Program) -> bool:
    """True if a loss of the program uses a target row without a measured value."""
    return any(_lacking(dataset, program.step, loss) for loss in program.losses)


def _lacking(dataset: Dataset, step: Graph, loss: Loss) -> list[str]:
    """The signals read by a loss's target that have no measured value in some rows.

    Empty for a target that reads several rows, such as a derivative: it also uses interpolated
    values.
    """
    if loss.target is None or not dataset.measured:
        return []
    found = reads(step, [loss.target])
    around = span(found.values())
    if around is None or around.first != around.last:
        return []
    return [signal for signal in found if signal in dataset.measured]


def target_extent(step: Graph, loss: Loss) -> Extent:
    """The samples relative to t that the target of a loss reads; t itself if there is no target."""
    if loss.target is None:
        return Extent(0, 0)
    return span(reads(step, [loss.target]).values()) or Extent(0, 0)


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
    count, left = full, np.zeros_like(full)
    if rest:
        left = samples - full * stride
        count = full + ((left > 0) & (full * stride < starts))
    ends = np.cumsum(count)
    # there may be as many rollouts as rows: few arrays of that size, and no loop over episodes
    t0 = np.full(int(count.sum()), stride, np.int64)
    there = count > 0
    last = (first + (count - 1) * stride)[there]
    t0[(ends - count)[there]] = first[there] - np.concatenate([[0], last[:-1]])
    np.cumsum(t0, out=t0)
    steps = np.broadcast_to(np.int64(horizon), len(t0))
    shorter = count > full
    if shorter.any():
        steps = steps.copy()
        steps[ends[shorter] - 1] = left[shorter]
    return Runs(t0, steps, int(np.sum(~there)), longest)
