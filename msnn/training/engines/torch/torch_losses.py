"""Sums the losses of a batch of rollouts in torch: windows are views of one gathered block."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from backends.torch_module.module import Frame, TorchModel, Windows
from compiler.ir.nodes import Extent, extents
from compiler.ir.program import Loss, Measure, Program
from msnn.data.dataset import BoolArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import LossSum, longest_first
from msnn.training.engines.engine import LossSums, batches_of

EVALUATION_BATCH = 4096
"""Rollouts evaluated in parallel; limits the memory."""


@dataclass(frozen=True, slots=True)
class TorchLossSum:
    """Σ of a loss over all scored elements, differentiable, and the number of these elements."""

    total: Tensor
    count: float

    def value(self, measure: Measure) -> Tensor:
        """The loss; 0 if no element was scored (rule R9)."""
        # differentiable without a scored element too: a batch may lack every target of one loss
        mean = self.total / (self.count or 1.0)
        if measure is Measure.RMSE and mean.item() > 0:  # the root has no slope at 0
            return mean.sqrt()
        return mean

    def numbers(self) -> LossSum:
        """The same as a LossSum, detached from torch's graph."""
        return LossSum(self.total.item(), self.count)


@dataclass(frozen=True, slots=True)
class TorchScoring:
    """The data of a stage as tensors, and which steps and rows of rollouts are scored."""

    series: Mapping[str, Tensor]
    skip: int
    missing: bool
    """True if targets may be NaN."""
    scored: Mapping[str, Tensor] | None
    """Mask of rows t at which each loss is scored; None for all rows."""


def scoring(
    model: TorchModel,
    series: Mapping[str, np.ndarray],
    skip: int,
    scored: Mapping[str, BoolArray] | None,
) -> TorchScoring:
    """Converts series to tensors with the dtype and device of a model.

    `skip` is the number of steps at the beginning of each rollout that are not scored. `scored` has
    a mask (rows,) for each loss; None scores all rows.
    """
    # looked for once: a mask where nothing can be missing would cost every batch
    missing = any(bool(np.isnan(values).any()) for values in series.values())
    place, dtype = model.device, model.dtype
    return TorchScoring(
        {name: torch.from_numpy(values).to(place, dtype) for name, values in series.items()},
        skip,
        missing,
        None if scored is None else {n: torch.from_numpy(r).to(place) for n, r in scored.items()},
    )


def batch_losses(
    model: TorchModel, data: TorchScoring, runs: Runs, frame: Frame | None = None
) -> dict[str, TorchLossSum]:
    """Every loss over rollouts that run in parallel, each until its last step.

    `frame` replaces the parameters of the model if given.
    """
    scored = scored_values(model, frame or model.frame(), data, runs)
    return {loss.name: _summed(loss, scored[loss.name], model) for loss in model.program.losses}


def evaluated(
    model: TorchModel, data: TorchScoring, runs: Runs, frame: Frame | None = None
) -> LossSums:
    """Every loss over any number of rollouts as numbers, without gradient."""
    sums: LossSums = {}
    with torch.no_grad():
        for part in batches_of(runs, EVALUATION_BATCH):
            for name, found in batch_losses(model, data, part, frame).items():
                sums[name] = sums.get(name, LossSum(0.0, 0)) + found.numbers()
    return sums


@dataclass(frozen=True, slots=True)
class ScoredValues:
    """Predictions and targets that a loss compares, one element for each scored number."""

    prediction: Tensor
    target: Tensor | None
    factors: Tensor | None
    """Weight of each element; None for 1."""
    runs: Tensor
    """Index of the rollout of each element."""


def scored_values(
    model: TorchModel, frame: Frame, data: TorchScoring, runs: Runs
) -> dict[str, ScoredValues | None]:
    """Simulates rollouts in parallel; returns the predictions and targets of each loss, None if
    none is scored.
    """
    program = model.program
    # sort by length: the rollouts that still run are then a slice of the batch
    order = longest_first(runs)
    t0 = torch.from_numpy(runs.t0[order]).to(model.device)
    members = torch.from_numpy(order).to(model.device)
    steps = runs.steps[order]
    block = _Block(program, data.series, t0, int(steps[0]))
    states = model.start_on(block.windows(0, len(t0)), frame, len(t0))
    parts: dict[str, list[_Part]] = {loss.name: [] for loss in program.losses}
    for number in range(int(steps[0])):
        # by falling length: rollouts that have this step stand first
        running = int(np.searchsorted(-steps, -number, side="left"))
        if running < len(t0) and number:
            states = {name: value[:running] for name, value in states.items()}
        values = model.step_on(block.windows(number, running), states, frame, running)
        states = values.next_states
        if number >= data.skip:
            for name, (prediction, target) in values.losses.items():
                rows = None if data.scored is None else data.scored[name][t0[:running] + number]
                factors = values.rows.get(name)
                parts[name].append(_Part(prediction, target, rows, factors, members[:running]))
    return {loss.name: _scored(parts[loss.name], data.missing) for loss in program.losses}


class _Block:
    """The data that a batch of rollouts reads, copied once: (B, *shape, rows) for each signal."""

    def __init__(
        self, program: Program, series: Mapping[str, Tensor], t0: Tensor, steps: int
    ) -> None:
        self._first: dict[str, int] = {}
        self._rows: dict[str, Tensor] = {}
        for name, extent in _reads(program, steps).items():
            offsets = torch.arange(extent.first, extent.last + 1, device=t0.device)
            # a rollout that ends early reads nothing of the rows that are cut off here
            rows = (t0[:, None] + offsets).clamp(0, len(series[name]) - 1)
            self._first[name] = extent.first
            self._rows[name] = torch.movedim(series[name][rows], 1, -1).contiguous()

    def windows(self, number: int, running: int) -> Windows:
        def windows(signal: str, first: int, last: int) -> Tensor:
            start = number + first - self._first[signal]
            return self._rows[signal][:running, ..., start : start + last - first + 1]

        return windows


def _reads(program: Program, steps: int) -> dict[str, Extent]:
    """The first and last sample, relative to the start row t0, that a rollout of `steps` steps
    reads per signal.
    """
    found: dict[str, Extent] = {}
    # the start runs at t0 alone, the step at t0 … t0 + steps − 1
    for graph, last in ((program.step, steps - 1), (program.start, 0)):
        for log in (True, False):
            for name, extent in extents(graph, log=log).items():
                whole = Extent(extent.first, extent.last + last)
                found[name] = found[name].union(whole) if name in found else whole
    return found


@dataclass(frozen=True, slots=True)
class _Part:
    prediction: Tensor
    target: Tensor | None
    rows: Tensor | None
    """Mask of scored rows."""
    factors: Tensor | None
    runs: Tensor

    def along(self, value: Tensor) -> Tensor:
        """The elements of `value` in scored rows."""
        return value if self.rows is None else value[self.rows]


def _scored(parts: list[_Part], missing: bool) -> ScoredValues | None:
    if not parts:
        return None
    prediction = _joined([part.along(part.prediction) for part in parts])
    targets = [part.along(part.target) for part in parts if part.target is not None]
    target = _joined(targets) if targets else None
    factors = [part.along(part.factors) for part in parts if part.factors is not None]

    def each_element(values: list[Tensor]) -> Tensor:
        # one of a row, for all elements of its prediction
        return _joined(values).reshape(-1, *[1] * (prediction.dim() - 1)).expand(prediction.shape)

    runs = each_element([part.along(part.runs) for part in parts])
    if not factors:
        if target is None or not missing:
            return ScoredValues(prediction, target, None, runs)
        there = ~torch.isnan(target)
        return ScoredValues(prediction[there], target[there], None, runs[there])
    each = each_element(factors)
    # a factor of 0 leaves out; 0 times NaN would not
    there = each > 0 if target is None else (each > 0) & ~torch.isnan(target)
    known = None if target is None else target[there]
    return ScoredValues(prediction[there], known, each[there], runs[there])


def _joined(parts: list[Tensor]) -> Tensor:
    return parts[0] if len(parts) == 1 else torch.cat(parts)


def _summed(loss: Loss, scored: ScoredValues | None, model: TorchModel) -> TorchLossSum:
    if scored is None:
        return TorchLossSum(torch.zeros((), dtype=model.dtype, device=model.device), 0)
    costs = cost(loss, scored.prediction, scored.target)
    if scored.factors is None:
        return TorchLossSum(costs.sum(), scored.prediction.numel())
    return TorchLossSum((scored.factors * costs).sum(), scored.factors.sum().item())


def cost(loss: Loss, prediction: Tensor, target: Tensor | None) -> Tensor:
    """The loss of each element: its squared error, absolute error, Huber cost or the prediction
    itself.

    A loss is the mean of these (its root for RMSE). Target None means 0.
    """
    error = prediction if target is None else prediction - target
    match loss.measure:
        case Measure.MSE | Measure.RMSE:
            return error * error
        case Measure.MAE:
            return error.abs()
        case Measure.HUBER:
            return torch.nn.functional.huber_loss(
                error, torch.zeros_like(error), reduction="none", delta=loss.delta
            )
        case Measure.MEAN:
            return prediction
