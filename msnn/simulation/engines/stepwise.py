"""Runs rollouts step by step in parallel, in the interpreter or any engine with single steps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.starts import Runs
from msnn.simulation.engines.engine import Advance, first_places
from msnn.simulation.rollout import LossSum, RolloutRow, moments, summed

SIDE_BY_SIDE = 4096
"""Number of rollouts that run in parallel; limits the memory."""

Steps = Callable[[Runs, bool], Iterable[RolloutRow]]
"""Yields every step of rollouts, with losses on request."""


class StepwiseRollouts:
    """An engine based on a function that computes one step of many rollouts."""

    def __init__(self, program: Program, steps: Steps) -> None:
        self._program, self._steps = program, steps

    def outputs(self, runs: Runs, advance: Advance) -> dict[str, FloatArray]:
        """Every output of the program, rollout after rollout."""
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
        """Every loss of the program, summed over batches of rollouts."""
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
    """The reference interpreter as an engine."""
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
