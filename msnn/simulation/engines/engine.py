"""Defines the interface and progress of rollout engines, and an engine that runs single steps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import LossSum, RolloutRow, moments, summed
from spec_schema.diagnostics.diagnostic import Diagnostic

EngineName: TypeAlias = Literal["interpreter", "native", "torch"]
"""Engines that need no export."""

ExportName: TypeAlias = Literal["onnx", "casadi", "c", "fmu"]
"""Exports that can simulate data."""

Advance: TypeAlias = Callable[[int], None]
"""Callback with the number of further completed steps."""


class RolloutEngine(Protocol):
    """An engine that simulates rollouts of a program with closed loops, given weights and data."""

    def outputs(self, runs: Runs, advance: Advance) -> Mapping[str, FloatArray]:
        """The values of every output, (Σ steps, *shape), one rollout after the other.

        The engine calls `advance` with the number of steps that it has computed.
        """
        ...

    def losses(
        self, runs: Runs, skip: int, scored: Mapping[str, BoolArray] | None, advance: Advance
    ) -> dict[str, LossSum]:
        """Every loss as its sum and count, over steps from `skip` on and rows in the mask
        `scored`.
        """
        ...


@dataclass(frozen=True, slots=True)
class OpenedRollouts:
    """An engine that is ready to simulate, its name, and diagnostics about its selection."""

    engine: RolloutEngine
    name: str
    """One of `EngineName` or `ExportName`."""
    notes: tuple[Diagnostic, ...] = ()


@dataclass(frozen=True, slots=True)
class EngineToOpen:
    """An engine that a function opens, called with a closed-loop program, weights and series."""

    open: Callable[[Program, Mapping[str, FloatArray], Mapping[str, FloatArray]], OpenedRollouts]


Engine: TypeAlias = str | EngineToOpen
"""A name for `open_rollouts`, or a factory."""


def first_places(runs: Runs) -> IntArray:
    """The position of each rollout's first step in the results of `outputs`."""
    return np.cumsum(runs.steps) - runs.steps


SIDE_BY_SIDE = 4096
"""Number of rollouts that run in parallel; limits the memory."""

Steps = Callable[[Runs, bool], Iterable[RolloutRow]]
"""Yields every step of rollouts, with losses on request."""


class StepwiseRollouts:
    """An engine from a function that yields one step of many rollouts after the other."""

    def __init__(self, program: Program, steps: Steps) -> None:
        self._program, self._steps = program, steps

    def outputs(self, runs: Runs, advance: Advance) -> dict[str, FloatArray]:
        """The values of every output, (Σ steps, *shape), one rollout after the other."""
        total, step = int(runs.steps.sum()), self._program.step
        found = {
            out.name: np.empty((total, *step[out.node].type.shape)) for out in self._program.outputs
        }
        first = first_places(runs)
        done = 0
        for part in _parts(runs):
            begins = first[done : done + len(part)]
            for row in self._steps(part, False):
                # rollouts lie one after the other, each as long as it is
                places = begins[row.members] + row.number
                for name, values in found.items():
                    values[places] = row.values.outputs[name]
                advance(len(places))
            done += len(part)
        return found

    def losses(
        self, runs: Runs, skip: int, scored: Mapping[str, BoolArray] | None, advance: Advance
    ) -> dict[str, LossSum]:
        """Every loss of the program as its sum and count, computed over batches of rollouts."""
        losses = self._program.losses
        totals = {loss.name: LossSum(0.0, 0) for loss in losses}
        for part in _parts(runs):
            rows = _counted(self._steps(part, True), advance)
            found = summed(losses, rows, skip, scored)
            totals = {name: total + found[name] for name, total in totals.items()}
        return totals


def interpreted_rollouts(
    program: Program, weights: Mapping[str, FloatArray], series: Mapping[str, FloatArray]
) -> StepwiseRollouts:
    """The reference interpreter as an engine; `series` are the data, (rows, *shape) by signal."""
    judge = Interpreter(program, weights)
    return StepwiseRollouts(
        program, lambda runs, losses: moments(judge, series, runs, losses=losses)
    )


def _parts(runs: Runs) -> list[Runs]:
    starts = range(0, len(runs), SIDE_BY_SIDE)
    return [runs.take(np.arange(s, min(s + SIDE_BY_SIDE, len(runs)))) for s in starts]


def _counted(rows: Iterable[RolloutRow], advance: Advance) -> Iterator[RolloutRow]:
    for row in rows:
        yield row
        advance(len(row.members))


RolloutProgress: TypeAlias = Callable[[int, int], None]
"""Callback with the number of completed steps and the total."""


def nobody(done: int, total: int) -> None:
    """A receiver of progress that ignores it."""
    del done, total


class Count:
    """Sums the steps that several engines have computed, and reports the sum to a receiver of
    progress.
    """

    def __init__(self, progress: RolloutProgress, total: int) -> None:
        self._progress, self._done, self._total = progress, 0, total

    def advance(self, steps: int) -> None:
        """Adds completed steps; steps that the interpreter repeats count again."""
        self._done += steps
        # never more done than there is
        self._progress(self._done, max(self._done, self._total))
