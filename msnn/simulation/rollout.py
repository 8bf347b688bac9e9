"""Runs many rollouts in parallel with the reference interpreter, and sums weighted losses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.interpreter import Interpreter, StepValues
from compiler.interpreter.operations import repeated_batch
from compiler.ir.program import Loss, Measure, Output, Program
from msnn.data.dataset import BoolArray, Dataset, FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.errors.data.rows import no_class, unfit_factor
from spec_schema.diagnostics.diagnostic import Findings


@dataclass(frozen=True, slots=True)
class RolloutRow:
    """The values of one step in all rollouts that still run, the longest first."""

    number: int
    """Index of the step, 0 at the start of each rollout."""
    members: IntArray
    """Indices of these rollouts in the `Runs`."""
    t: IntArray
    values: StepValues


@dataclass(frozen=True, slots=True)
class LossSum:
    """The sum of a loss over all scored elements, and their number; both weighted by row
    factors.
    """

    total: float
    count: float

    def value(self, measure: Measure) -> float:
        """The loss; 0 if nothing was scored (rule R9)."""
        mean = self.total / self.count if self.count else 0.0
        # root of the overall mean: a mean of roots would depend on the length of rollouts
        return float(np.sqrt(mean)) if measure is Measure.RMSE else mean

    def __add__(self, other: LossSum) -> LossSum:
        return LossSum(self.total + other.total, self.count + other.count)


def entry_value(program: Program, name: str, values: Mapping[str, float]) -> float:
    """The value of a `losses:` entry, which is the sum of its terms, or of a single term."""
    if name in values:
        return values[name]
    # an entry such as `mse(a, b) + 2 * mse(c, d)` is several losses, each with its share
    return sum(loss.share * values[loss.name] for loss in program.losses if loss.entry == name)


def longest_first(runs: Runs) -> IntArray:
    """Indices of rollouts sorted by length, as in `moments` and in engines: the shortest last."""
    # stable: rollouts alike long keep their order, and with it the order of all sums
    return np.argsort(-runs.steps, kind="stable")


def moments(
    interpreter: Interpreter, series: Mapping[str, FloatArray], runs: Runs, *, losses: bool
) -> Iterator[RolloutRow]:
    """Simulates rollouts and yields their steps one after the other, for all rollouts together.

    With `losses`, each step also has predictions and targets of losses. Ended rollouts are omitted.
    """
    order = longest_first(runs)
    t0, steps = runs.t0[order], runs.steps[order]
    if not len(order):
        return
    states = interpreter.start(series, t0)
    for number in range(int(steps[0])):
        # by falling length: members that have this step stand first
        running = int(np.searchsorted(-steps, -number, side="left"))
        # views, no copies, and only when one has ended
        if running < len(next(iter(states.values()), t0)):
            states = {name: value[:running] for name, value in states.items()}
        t = t0[:running] + number
        values = interpreter.step(series, t, states, losses=losses)
        yield RolloutRow(number, order[:running], t, values)
        states = values.next_states


def loss_sums(
    interpreter: Interpreter,
    series: Mapping[str, FloatArray],
    runs: Runs,
    skip: int = 0,
    scored: Mapping[str, BoolArray] | None = None,
) -> dict[str, LossSum]:
    """Every loss of the program over the rollouts, from step `skip` on (rule R9).

    `scored` limits a loss to a mask of rows t; elements without a target are not scored.
    """
    rows = moments(interpreter, series, runs, losses=True)
    return summed(interpreter.program.losses, rows, skip, scored)


def summed(
    losses: Iterable[Loss],
    moments: Iterable[RolloutRow],
    skip: int,
    scored: Mapping[str, BoolArray] | None,
) -> dict[str, LossSum]:
    """Sums every loss over steps of rollouts, of which `moments` yields one after the other.

    `skip` and `scored` are those of `loss_sums`.
    """
    named = {loss.name: loss for loss in losses}
    sums = dict.fromkeys(named, LossSum(0.0, 0))
    for moment in moments:
        if moment.number < skip:
            continue
        for name, (prediction, target) in moment.values.losses.items():
            rows = np.ones(len(moment.t), dtype=np.bool_)
            if scored is not None:
                rows = scored[name][moment.t]
            there = (
                # NaN is a missing target; an infinite one counts, and makes the loss infinite
                np.ones(prediction.shape, dtype=np.bool_) if target is None else ~np.isnan(target)
            )
            # a row counts or not, elements of it may be missing besides
            there &= _along(rows, prediction)
            each = _factors(named[name], moment.values, prediction)
            sums[name] += _sum(named[name], prediction, target, there, each)
    return sums


def _along(rows: NDArray[Any], like: FloatArray) -> NDArray[Any]:
    """One value per rollout, broadcast to the shape of `like`."""
    return np.broadcast_to(rows.reshape(-1, *[1] * (like.ndim - 1)), like.shape)


def _factors(loss: Loss, values: StepValues, like: FloatArray) -> FloatArray | None:
    """The weight of each element; None if all are 1."""
    if loss.rows is None:
        return None
    factors = values.nodes[loss.rows]
    assert factors is not None, "a loss is computed with the factors of its rows"
    return _along(repeated_batch(factors, len(like)), like)


def _sum(
    loss: Loss,
    prediction: FloatArray,
    target: FloatArray | None,
    scored: BoolArray,
    factors: FloatArray | None,
) -> LossSum:
    if factors is not None:
        # a factor of 0 leaves an element out, whatever stands there
        scored = scored & (factors > 0)
    with np.errstate(over="ignore"):  # a sum that overflows is infinite, and said to diverge
        costs = cost(loss, prediction[scored], None if target is None else target[scored])
        if factors is None:
            return LossSum(float(np.sum(costs)), costs.size)
        each = factors[scored]
        return LossSum(float(np.sum(each * costs)), float(np.sum(each)))


def cost(loss: Loss, prediction: FloatArray, target: FloatArray | None) -> FloatArray:
    """The loss of each element: its squared error, absolute error, Huber cost or the prediction
    itself.

    A loss is the mean of these (its root for RMSE). Target None means 0.
    """
    error = prediction if target is None else prediction - target
    match loss.measure:
        case Measure.MSE | Measure.RMSE:
            return error * error
        case Measure.MAE:
            return np.abs(error)
        case Measure.HUBER:
            size = np.abs(error)
            # the parabola and the straight line meet at an error of δ
            line = loss.delta * (size - 0.5 * loss.delta)
            return np.where(size <= loss.delta, 0.5 * error * error, line)
        case Measure.MEAN:
            return prediction


_AT_ONCE = 1 << 16


def check_row_factors(
    program: Program,
    data: Dataset,
    runs: Runs,
    rows: Mapping[str, BoolArray] | None,
    findings: Findings,
) -> None:
    """Reports factors that are negative or not finite, in scored rows of rollouts."""
    checked: set[int] = set()
    for loss in program.losses:
        if loss.rows is None or loss.rows in checked:
            continue
        checked.add(loss.rows)
        t = _evaluated(runs, data.rows)
        if rows is not None:
            t = t[rows[loss.name][t]]
        factors = _of_rows(program, loss, loss.rows, data, t)
        bad = np.flatnonzero(~(np.isfinite(factors) & (factors >= 0)))
        if len(bad):
            place, value = data.place(int(t[bad[0]])), float(factors[bad[0]])
            findings.report(unfit_factor(loss.entry, value, place, len(bad), loss.span))


def check_classes(program: Program, data: Dataset, runs: Runs, findings: Findings) -> None:
    """Reports labels that are not classes of a cross-entropy, in rows of rollouts."""
    for loss in program.losses:
        # of the measures with a target a mean alone has marks: NaN is missing, 0 is a class
        if loss.measure is not Measure.MEAN or loss.target is None:
            continue
        t = _evaluated(runs, data.rows)
        marks = _of_rows(program, loss, loss.target, data, t).reshape(len(t), -1)
        bad = np.argwhere((marks != 0) & ~np.isnan(marks))
        if len(bad):
            row, element = bad[0]
            place, value = data.place(int(t[row])), float(marks[row, element])
            findings.report(no_class(loss.entry, value, place, len(bad), loss.span))


def _evaluated(runs: Runs, rows: int) -> IntArray:
    """The rows t of the data at which a step of any run begins, each once; the data have `rows`."""
    # +1 where a rollout begins, −1 behind its end: the sum says how many evaluate a row
    changes = np.zeros(rows + 1, np.int64)
    # add.at: rollouts may begin in one row, which `changes[t0] += 1` would count once
    np.add.at(changes, runs.t0, 1)
    np.add.at(changes, runs.t0 + runs.steps, -1)
    return np.flatnonzero(np.cumsum(changes[:-1]))


def _of_rows(program: Program, loss: Loss, node: int, data: Dataset, t: IntArray) -> FloatArray:
    """The values of a node that depends only on data, at the rows `t`."""
    output = Output(loss.name, node)
    # factors read the log alone: nothing else of the step is computed
    alone = replace(program, outputs=(output,), losses=(), states=(), expected=(), fits=())
    judge = Interpreter(alone)
    parts = [
        judge.step(data.series, t[begin : begin + _AT_ONCE], {}, losses=False).outputs[loss.name]
        for begin in range(0, len(t), _AT_ONCE)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)
