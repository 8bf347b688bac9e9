"""Evaluates the graphs of training in the interpreter, with rounding bounds: the reference for
training kernels.

It uses the graphs of the training kernels, in their precision. The step runs forward over a
horizon; then the reverse step runs from the last sample to the first, and the reverse start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.differentiation.sensitivities import LossResiduals, Sensitivities
from compiler.differentiation.training_step import LossTerm, TrainingStep
from compiler.interpreter.bounded import AdjointTape, Bounded, Total, exact, unit_roundoff
from compiler.interpreter.operations import Array
from compiler.interpreter.rounding import BoundedGraph, Forward, Rollouts, RolloutStep
from compiler.ir.ops import LossScale, NewestSample, StateAdjoint, TrainingValue
from compiler.ir.program import NodeId


@dataclass(frozen=True, slots=True)
class InterpretedLosses:
    """For every loss its sum and its number of scored elements, by name, and the gradient of the
    weighted total.
    """

    sums: dict[str, Total]
    counts: dict[str, Total]
    gradient: dict[str, Total]
    """The gradient with respect to each parameter in its physical unit, by name."""


class InterpretedTraining:
    """Evaluates the graphs of one training step with these weights (physical, by name) in the
    precision `dtype`.
    """

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
        """The sum of every loss over the rollouts `runs`, and the gradient of Σ weight · loss;
        `loss_weights` has the weight of each loss by name.
        """
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
    """∂(weighted total)/∂(sum of the loss `term`) in float64, and a bound on its error; 0 if
    nothing is scored. `total` is the sum of the loss, `counts` are the numbers of scored elements
    and `weights` the weights, by loss.
    """
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
    """The scalar `value` with the rounding bound `error`, repeated for every member."""
    one = exact(np.full(members, value, dtype))
    return Bounded(one.value, one.error + error, one.terms + error, 1)


_DTYPE: np.dtype[Any] = np.dtype(np.float64)


@dataclass(frozen=True, slots=True)
class InterpretedProducts:
    """The products [J r]ᵀ[J r] of one loss Σ r², with J = ∂r/∂θ, and the sum of its cost. The shape
    is (n + 1, n + 1) for n learned elements.
    """

    products: Total
    cost: Total
    count: Total
    """Number of scored elements, weighted by the factors of their rows."""
    left_out: Total
    """Number of scored elements that the products exclude."""


def interpreted_products(
    found: Sensitivities, weights: Mapping[str, Array], runs: Rollouts
) -> dict[str, InterpretedProducts]:
    """The products, by loss, of every loss that is a sum of squares, over the rollouts `runs`, in
    float64. `found` is the program with its sensitivities, `weights` are physical arrays by name.
    """
    terms = {term.loss.name: term for term in found.losses}
    summed = [node for term in found.losses for node in (term.total, term.count)]
    wanted = [node for one in found.residuals for node in (one.values, one.slopes, one.left_out)]
    asked = [node for node in (*summed, *wanted) if node is not None]
    forward = Forward(found.program, asked, weights, _DTYPE)
    sums = {
        one.loss.name: InterpretedProducts(*(Total(_DTYPE) for _ in range(4)))
        for one in found.residuals
    }
    members = len(runs.t0)
    # the first `skip` samples of a rollout let the states settle; no loss counts them
    for moment in forward.moments(runs)[runs.skip :]:
        for one in found.residuals:
            total, term = sums[one.loss.name], terms[one.loss.name]
            total.cost.add(moment.values[term.total].repeated(members))
            every = exact(np.full(members, float(term.elements)))
            count = every if term.count is None else moment.values[term.count].repeated(members)
            total.count.add(count)
            total.products.add(_products(_rows(one, moment, found.numbers, members)))
            if one.left_out is not None:
                total.left_out.add(_over_elements(moment.values[one.left_out].repeated(members)))
    return sums


def _rows(
    one: LossResiduals, moment: RolloutStep, numbers: int, members: int
) -> tuple[Array, Array]:
    """The rows [J r] of the loss `one` in the step `moment`, (members, elements, numbers + 1), and
    a bound on the error of each element. `numbers` is the number of learned elements.
    """
    unit = unit_roundoff(_DTYPE)
    values, slopes = (moment.values[node].repeated(members) for node in (one.values, one.slopes))

    def joined(of_slopes: Array, of_values: Array) -> Array:
        # (members, numbers, …) → (members, elements, numbers), with the residual as the last column
        columns = of_slopes.reshape(members, numbers, -1).transpose(0, 2, 1)
        return np.concatenate([columns, of_values.reshape(members, -1, 1)], axis=2)

    return (
        joined(slopes.value, values.value),
        joined(slopes.spread(unit), values.spread(unit)),
    )


def _over_elements(one: Bounded) -> Bounded:
    """The sum over all elements of the value `one`, for each member."""
    value, error, terms = (part.reshape(len(part), -1) for part in one.parts)
    return Bounded(value.sum(1), error.sum(1), terms.sum(1), one.count * value.shape[1])


def _products(rows: tuple[Array, Array]) -> Bounded:
    """The products [J r]ᵀ[J r] of each member, summed over its elements, with bounds; `rows` is the
    result of `_rows`.
    """
    row, off = rows
    size = np.abs(row)
    with np.errstate(all="ignore"):
        value = row.transpose(0, 2, 1) @ row
        terms = (size + off).transpose(0, 2, 1) @ (size + off)
        moved = size.transpose(0, 2, 1) @ off
        error = moved + (off.transpose(0, 2, 1) @ (size + off)) + unit_roundoff(_DTYPE) * terms
    return Bounded(value, np.where(np.isnan(error), np.inf, error), terms, row.shape[1])
