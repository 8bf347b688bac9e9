"""Checks values at steps where rounding decides a condition: they must match one branch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.interpreter import physical_weights
from msnn.agreement.faults import Fault, NoChoice
from msnn.agreement.judging.judgement import Arrays, FloatType, Judgement, labelled, labelled_first
from msnn.agreement.judging.record import AgreementRecord
from msnn.agreement.rounding.rounding_cost import STEP_LIMIT
from msnn.agreement.rounding.undecided import OpenDecision, Steps, undecided
from msnn.agreement.subject import Subject


@dataclass(frozen=True, slots=True)
class Branches:
    """The steps at which undecided conditions lead to different values."""

    at: Mapping[str, NDArray[np.bool_]]
    """Masks (steps,) by names of values in messages; an initial state has one step."""
    faults: tuple[Fault, ...]
    """Values that match no branch."""

    def settled(self, found: Arrays, judged: Arrays) -> dict[str, NDArray[Any]]:
        """The values with the reference's at these steps, so that only the others are compared."""
        settled = dict(found)
        for name, where in self.at.items():
            if where.any():
                settled[name] = np.array(found[name])
                settled[name][where] = judged[name][: len(where)][where]
        return settled

    @property
    def counts(self) -> dict[str, int]:
        """Number of these steps per value, where it is not 0."""
        return {name: int(where.sum()) for name, where in self.at.items() if where.any()}

    @property
    def untried(self) -> tuple[str, ...]:
        """Values with these steps only, so that no step was compared."""
        return tuple(name for name, where in self.at.items() if where.all())


def branches(
    subject: Subject, dtype: FloatType, record: AgreementRecord, wanted: Judgement, found: Arrays
) -> Branches:
    """Compares each step with an undecided condition with the results of its branches.

    If all branches agree within rounding, the step is compared normally: near the threshold of
    `where(x > 0, x, 0)` both are equal. Other steps are counted; their values must match one branch
    within rounding.
    """
    program = subject.program
    weights = physical_weights(program, subject.weights)
    # values are compared under the names that messages give them: outputs and states may share one
    judged = labelled(wanted.outputs, wanted.next_states) | labelled_first(wanted.states)
    steps = Steps(
        graph=program.step,
        nodes=labelled(
            {output.name: output.node for output in program.outputs},
            {state.name: state.next for state in program.states},
        ),
        weights=weights,
        log=record.log,
        rows=record.t0 + np.arange(record.steps),
        states=wanted.states,
    )
    firsts = Steps(
        graph=program.start,
        nodes=labelled_first({state.name: state.start for state in program.states}),
        weights=weights,
        log=record.log,
        rows=np.array([record.t0]),
        states={},
    )
    at: dict[str, NDArray[np.bool_]] = {}
    faults: list[Fault] = []
    for given in (steps, firsts):
        left_open = undecided(given, dtype)
        # first states are judged like steps: their graph has conditions too
        for name in given.nodes:
            value = _Value(name, judged[name], found[name], STEP_LIMIT[dtype])
            where = np.zeros(len(given.rows), bool)
            # steps that leave more open than is tried are compared with nothing, and counted
            where[list(left_open.vast)] = True
            by_step: dict[int, list[OpenDecision]] = {}
            for choice in left_open.choices:
                by_step.setdefault(choice.step, []).append(choice)
            for step, choices in by_step.items():
                # with all choices near to the judge there is no decision of rounding to speak of
                where[step] = not all(value.is_judged(choice) for choice in choices)
                fault = value.fault(choices) if where[step] else None
                if fault is not None:
                    faults.append(fault)
            at[name] = where
    return Branches(at, _worst(faults))


@dataclass(frozen=True, slots=True)
class _Value:
    name: str
    judged: NDArray[Any]
    found: NDArray[Any]
    granted: float
    """Tolerance relative to the largest magnitude."""

    @property
    def scale(self) -> float:
        # relative to the largest of the record: a value that is 0 now has no size
        finite = np.abs(self.judged[np.isfinite(self.judged)])
        return float(finite.max(initial=0.0))

    def is_judged(self, choice: OpenDecision) -> bool:
        """True if a branch agrees with the reference within rounding."""
        return self._excess(choice, self.judged[choice.step]) <= 0.0

    def fault(self, choices: list[OpenDecision]) -> Fault | None:
        """The fault if the value matches no branch at its step."""
        step = choices[0].step
        if any(self._excess(choice, self.found[step]) <= 0.0 for choice in choices):
            return None
        nearest = min(_distance(choice.values[self.name], self.found[step]) for choice in choices)
        return NoChoice(self.name, step, nearest)

    def _excess(self, choice: OpenDecision, value: NDArray[Any]) -> float:
        """The difference between a value and a branch, minus the bound of rounding."""
        mine = choice.values[self.name].astype(float)
        # both are within the spread of the exact value
        room = np.maximum(2.0 * choice.spreads[self.name], self.granted * self.scale)
        same = (mine == value) | (np.isnan(mine) & np.isnan(value)) | (room == math.inf)
        excess = np.where(same, 0.0, np.abs(mine - value) - room)
        return float(np.where(np.isnan(excess), math.inf, excess).max(initial=0.0))


def _distance(left: NDArray[Any], right: NDArray[Any]) -> float:
    error = np.abs(left.astype(float) - right)
    return float(np.where(np.isnan(error), math.inf, error).max(initial=0.0))


def _worst(faults: list[Fault]) -> tuple[Fault, ...]:
    """The largest fault of each value."""
    found: dict[str, Fault] = {}
    for fault in faults:
        assert isinstance(fault, NoChoice)
        known = found.get(fault.of)
        if not isinstance(known, NoChoice) or fault.error > known.error:
            found[fault.of] = fault
    return tuple(found.values())
