"""Evaluates the training graphs in the interpreter, with rounding bounds, as reference for kernels.

It uses the graphs of the training kernels, in their precision. The step runs forward over a
horizon; then the reverse step runs from the last sample to the first, and the reverse start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.differentiation.training_step import LossTerm, TrainingStep
from compiler.interpreter.bounded import Bounded, exact
from compiler.interpreter.bounded_rollouts import Forward, Rollouts, RolloutStep
from compiler.interpreter.bounded_sums import AdjointTape, Total
from compiler.interpreter.operations import Array
from compiler.interpreter.rounding import BoundedGraph
from compiler.ir.program import NodeId
from compiler.ir.training.values import LossScale, NewestSample, StateAdjoint, TrainingValue


@dataclass(frozen=True, slots=True)
class InterpretedLosses:
    """Σ of every loss, the number of scored elements, and the gradient of the weighted total."""

    sums: dict[str, Total]
    counts: dict[str, Total]
    gradient: dict[str, Total]
    """By parameter, in physical values."""


class InterpretedTraining:
    """The graphs of one training step with given weights, in one precision."""

    def __init__(
        self, step: TrainingStep, weights: Mapping[str, Array], dtype: np.dtype[Any]
    ) -> None:
        self._step, self._dtype = step, dtype
        program = step.program
        reverse, start = step.reverse_step, step.reverse_start
        totals = [node for term in step.losses for node in _results(term)]
        self._forward = Forward(program, [*step.newest.values(), *totals], weights, dtype)
        found = reverse.gradients
        self._reverse = BoundedGraph(
            reverse.graph, [*found.states.values(), *found.parameters.values()], weights, dtype
        )
        self._reverse_start = BoundedGraph(
            start.graph, list(start.gradients.parameters.values()), weights, dtype
        )

    def losses(self, runs: Rollouts, loss_weights: Mapping[str, float]) -> InterpretedLosses:
        """The sums of every loss over these rollouts, and the gradient of Σ weight · loss."""
        moments = list(self._forward.moments(runs))
        sums = {term.loss.name: Total(self._dtype) for term in self._step.losses}
        counts = {name: Total(self._dtype) for name in sums}
        members = len(runs.t0)
        for number, moment in enumerate(moments):
            # the first `skip` samples of a rollout let the states settle; no loss counts them
            if number < runs.skip:
                continue
            for term in self._step.losses:
                name = term.loss.name
                sums[name].add(moment.values[term.total].repeated(members))
                if term.count is None:
                    scored = _number(float(term.elements), 0.0, members, self._dtype)
                else:
                    scored = moment.values[term.count].repeated(members)
                counts[name].add(scored)
        scales = {
            term.loss.name: _scale(term, sums[term.loss.name], counts, loss_weights)
            for term in self._step.losses
        }
        return InterpretedLosses(sums, counts, self._gradient(runs, moments, scales))

    def _gradient(
        self,
        runs: Rollouts,
        moments: Sequence[RolloutStep],
        scales: Mapping[str, tuple[float, float]],
    ) -> dict[str, Total]:
        program, members = self._step.program, len(runs.t0)
        gradient = {p.name: Total(self._dtype) for p in program.parameters}
        adjoints = {
            state.name: AdjointTape.of_zeros(
                members,
                tuple(axis.size for axis in state.axes),
                # buffers have one adjoint per sample, on a tape over all steps
                runs.steps if state.name in self._step.newest else None,
                self._dtype,
            )
            for state in program.states
        }
        found = self._step.reverse_step.gradients
        for number in range(runs.steps - 1, -1, -1):
            moment = moments[number]
            given: dict[TrainingValue, Bounded] = {}
            for name, node in self._step.newest.items():
                given[NewestSample(name)] = moment.values[node].repeated(members)
            for name, tape in adjoints.items():
                given[StateAdjoint(name)] = tape.after(number)
            for name, (value, error) in scales.items():
                # a step that no loss counts has scale 0, but still propagates adjoints
                scored = number >= runs.skip
                given[LossScale(name)] = _number(
                    value if scored else 0.0, error if scored else 0.0, members, self._dtype
                )
            values = self._reverse.run(runs.log, runs.t0 + number, moment.states, given)
            for name, tape in adjoints.items():
                node = found.states.get(name)
                tape.go_back(number, None if node is None else values[node].repeated(members))
            for name, node in found.parameters.items():
                gradient[name].add(values[node].repeated(members))
        at_start = {StateAdjoint(name): tape.at_start() for name, tape in adjoints.items()}
        values = self._reverse_start.run(runs.log, runs.t0, {}, {**at_start})
        for name, node in self._step.reverse_start.gradients.parameters.items():
            gradient[name].add(values[node].repeated(members))
        return gradient


def _results(term: LossTerm) -> list[NodeId]:
    return [term.total] if term.count is None else [term.total, term.count]


def _scale(
    term: LossTerm, total: Total, counts: Mapping[str, Total], weights: Mapping[str, float]
) -> tuple[float, float]:
    """∂(weighted total)/∂(sum of this loss), in float64, and its error bound."""
    count, weight = float(counts[term.loss.name].value), weights[term.loss.name]
    if count == 0:
        return 0.0, 0.0
    # row factors are data and round; a number of elements is exact
    part = float(counts[term.loss.name].off()) / count if term.loss.rows is not None else 0.0
    if not term.is_root:
        found = weight / count
        return found, abs(found) * part

    # ∂√(s/n)/∂s = 1 / (2 n √(s/n)), s the sum and n the count
    def slope(mean: float) -> float:
        return weight / (2.0 * float(np.sqrt(mean)) * count) if mean > 0 else np.inf

    value, off = float(total.value), float(total.off())
    if value == 0 and off == 0:
        return 0.0, 0.0
    # the derivative of the root is largest at the smallest mean that rounding allows
    most, found = slope((value - off) / count), slope(value / count)
    return found, abs(most - found) + abs(most) * part


def _number(value: float, error: float, members: int, dtype: np.dtype[Any]) -> Bounded:
    """A scalar for every member."""
    one = exact(np.full(members, value, dtype))
    return Bounded(one.value, one.error + error, one.terms + error, 1)
