"""Simulates entries of `validate`, each kind of simulation once, and evaluates them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from compiler.ir.kept_results import kept_for_same
from compiler.ir.program import Loss, Output, Program
from compiler.passes.simplify import drop_unused
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.engines.engine import (
    Advance,
    Engine,
    OpenedRollouts,
    RolloutEngine,
    interpreted_rollouts,
)
from msnn.simulation.engines.open_rollouts import open_rollouts
from msnn.simulation.rollout import LossSum, entry_value
from msnn.simulation.rollout_plan import counted_rows
from msnn.validation.measurement import Measurement, Measuring, loss_in_doubt
from msnn.validation.ready_check import ReadyCheck
from spec_schema.diagnostics.diagnostic import Diagnostic

_STEPS = 1 << 21
"""Steps simulated before they are evaluated, or the number of rows if that is larger."""


@dataclass(frozen=True, slots=True)
class LossValue:
    """The value of a loss, and the number of scored elements weighted by row factors."""

    value: float
    scored: float


Outcome = Measurement | LossValue


@dataclass(frozen=True, slots=True)
class FoundOutcomes:
    """The results of some entries; `is_doubtful` if one is within rounding of a limit."""

    outcomes: list[Outcome]
    is_doubtful: bool


class Simulator:
    """Simulates with one engine and one set of weights; reports progress by `advance`."""

    def __init__(
        self,
        engine: Engine,
        weights: Mapping[str, FloatArray],
        advance: Advance,
        *,
        judges: bool = True,
        learned: int = 0,
    ) -> None:
        """`learned` is the number of trained parameters, which `aic` counts."""
        self._engine, self._weights, self._advance = engine, weights, advance
        self._judges, self._learned = judges, learned
        self.notes: dict[Diagnostic, None] = {}
        """Notes for the user about the selection of engines."""

    def outcomes(self, checks: Sequence[ReadyCheck]) -> list[Outcome]:
        """The result of every entry of `validate`; entries with the same evaluation share it."""
        found: dict[int, Outcome] = {}
        # a rollout answers all entries that are simulated alike: outputs apart from losses, as the
        # two keep different nodes
        for group in simulated_together(checks):
            entries = [checks[index] for index in group]
            outcomes = self._losses if entries[0].plan.metric is None else self._measurements
            found |= dict(zip(group, outcomes(entries), strict=True))
        return [found[index] for index in range(len(checks))]

    def _measurements(self, checks: list[ReadyCheck]) -> list[Outcome]:
        first = checks[0]
        names = frozenset(check.plan.of for check in checks)
        program = _measured_program(first.plan.rollout.program, names)
        parts = rollout_parts(first.runs, max(_STEPS, first.data.rows))

        def found(engine: RolloutEngine) -> FoundOutcomes:
            each = _measured_by(checks, parts, self._learned)
            results: dict[Measuring, Measurement] = {}
            for part in parts:
                outputs = engine.outputs(part, self._advance)
                # each once, though several entries share it
                for measuring in dict.fromkeys(each):
                    measuring.add(part, outputs[measuring.of])
                    # at once, not at the end: then its memory is free for the next
                    if part is parts[-1]:
                        results[measuring] = measuring.measurement(judges=self._judges)
            doubtful = any(m.is_in_doubt(c.plan) for m, c in zip(each, checks, strict=True))
            return FoundOutcomes([results[measuring] for measuring in each], doubtful)

        return self._judged(program, first, found)

    def _losses(self, checks: list[ReadyCheck]) -> list[Outcome]:
        names = {check.plan.of for check in checks}
        first = checks[0]
        program = reduced(
            first.plan.rollout.program,
            lambda _: False,
            lambda loss: bool(names & {loss.name, loss.entry}),
        )
        rows = counted_rows(first.plan.rollout, first.data, first.name)

        def found(engine: RolloutEngine) -> FoundOutcomes:
            sums = engine.losses(first.runs, first.plan.rollout.skip, rows, self._advance)
            values = [_loss_value(program, check.plan.of, sums) for check in checks]
            pairs = zip(checks, values, strict=True)
            doubtful = any(loss_in_doubt(check.plan, one.value) for check, one in pairs)
            return FoundOutcomes([*values], doubtful)

        return self._judged(program, first, found)

    def _judged(
        self, program: Program, check: ReadyCheck, found: Callable[[RolloutEngine], FoundOutcomes]
    ) -> list[Outcome]:
        """The results of the engine; those of the interpreter if one is within rounding of
        a limit.
        """
        opened = self._opened(program, check)
        # limits are checked with the interpreter if engines could disagree (decision 0218)
        answer = found(opened.engine)
        if answer.is_doubtful and opened.name != "interpreter":
            answer = found(interpreted_rollouts(program, self._weights, check.series))
        return answer.outcomes

    def _opened(self, program: Program, check: ReadyCheck) -> OpenedRollouts:
        opened = open_rollouts(self._engine, program, self._weights, check.series, check.runs)
        self.notes |= dict.fromkeys(opened.notes)
        return opened


def simulated_together(checks: Sequence[ReadyCheck]) -> list[list[int]]:
    """Groups of indices of entries that need the same simulation; outputs and losses are apart."""
    groups: list[list[int]] = []
    for index, check in enumerate(checks):
        is_loss = check.plan.metric is None
        for group in groups:
            first = checks[group[0]]
            if (first.plan.metric is None) is is_loss and check.is_simulated_as(first):
                group.append(index)
                break
        else:
            groups.append([index])
    return groups


# entries, folds and sets ask for the same program again and again
@kept_for_same(4)
def _measured_program(program: Program, names: frozenset[str]) -> Program:
    """The part of a program that computes the outputs `names` only."""
    return reduced(program, lambda output: output.name in names, lambda _: False)


def reduced(
    program: Program, output: Callable[[Output], bool], loss: Callable[[Loss], bool]
) -> Program:
    outputs = tuple(filter(output, program.outputs))
    return drop_unused(
        replace(program, outputs=outputs, losses=tuple(filter(loss, program.losses)))
    )


def _loss_value(program: Program, name: str, sums: Mapping[str, LossSum]) -> LossValue:
    terms = [loss for loss in program.losses if name in (loss.name, loss.entry)]
    # of a loss the terms each have their own measure: they join at the end
    values = {term.name: sums[term.name].value(term.measure) for term in terms}
    scored = max(sums[term.name].count for term in terms)
    # the mean of nothing is no number, so that it keeps no limit
    return LossValue(entry_value(program, name, values) if scored else math.nan, scored)


def _measured_by(checks: list[ReadyCheck], parts: Sequence[Runs], learned: int) -> list[Measuring]:
    """An object that collects errors for each entry; entries with the same evaluation share one."""
    found: list[Measuring] = []
    for index, check in enumerate(checks):
        alike = next((i for i in range(index) if check.is_measured_as(checks[i])), None)
        found.append(Measuring(check, parts, learned) if alike is None else found[alike])
    return found


def rollout_parts(runs: Runs, steps: int) -> list[Runs]:
    """Splits the rollouts, in their order, into parts of about `steps` steps in total."""
    done = np.cumsum(runs.steps)
    # by where each rollout begins, so that none is cut
    block = (done - runs.steps) // steps
    begins = [*np.flatnonzero(np.diff(block, prepend=-1)).tolist(), len(runs)]
    return [runs.take(np.arange(begin, end)) for begin, end in pairwise(begins)]
