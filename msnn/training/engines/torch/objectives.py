"""Provides objectives for torch optimisers: losses unrolled in torch or computed by a kernel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from backends.native.kernel import Kernel
from backends.native.kernel_data import Groups, KernelData
from backends.torch_module.module import TorchModel
from compiler.differentiation.training_step import training_step
from compiler.ir.program import Measure
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.starts import Runs
from msnn.simulation.engines.kernel_check import check_kernel
from msnn.simulation.engines.kernel_trials import check_if_fresh
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import LossSums
from msnn.training.engines.own_series import own_series, without_masks
from msnn.training.engines.torch.torch_losses import (
    TorchScoring,
    batch_losses,
    evaluated,
    scoring,
)
from msnn.training.plans.stage_plan import StagePlan

RowsByLoss = Mapping[str, BoolArray]


@dataclass(frozen=True, slots=True)
class Scored:
    """The weighted total of a batch, differentiable in the raw variables, and its losses."""

    total: Tensor
    losses: LossSums


class TorchObjective:
    """Unrolls the program's module."""

    def __init__(
        self,
        model: TorchModel,
        plan: StagePlan,
        series: Mapping[str, FloatArray],
        train_rows: RowsByLoss | None,
        evaluation_rows: RowsByLoss | None,
    ) -> None:
        self._model, self._plan = model, plan
        self.has_infinite_slopes = training_step(plan.program).has_infinite_slopes
        """True if the gradient of a finite total can be infinite."""
        series = own_series(plan, series)
        self._series, self._train_rows = series, train_rows
        self._measured: TorchScoring | None = None
        self._train = scoring(model, own_series(plan, series), plan.rollout.skip, train_rows)
        self._evaluation = scoring(model, series, plan.rollout.skip, evaluation_rows)

    def check(self, runs: Runs) -> None:
        """Does nothing: torch needs no check against the reference interpreter."""

    def write(self, series: Mapping[str, FloatArray], *, watched: bool = False) -> None:
        """Replaces series that training or watched rollouts read (see `own_series`)."""
        _write(self._evaluation if watched else self._train, series)
        if not watched:
            measured = without_masks(self._plan, series)
            self._series |= measured
            if self._measured is not None:
                _write(self._measured, measured)

    def scored(self, runs: Runs) -> Scored:
        """The losses of training rollouts."""
        sums = batch_losses(self._model, self._train, runs)
        terms = [
            # a penalty is not smooth, so no gradient step is taken: it counts in the total, and the
            # optimiser's proximal step moves it (decision 0215)
            weight * (value if loss.penalty is None else value.detach())
            for loss in self._plan.program.losses
            if (weight := self._plan.loss_weights[loss.name])
            for value in (sums[loss.name].value(loss.measure),)
        ]
        numbers = {name: found.numbers() for name, found in sums.items()}
        return Scored(torch.stack(terms).sum(), numbers)

    def evaluate(self, runs: Runs) -> LossSums:
        """The losses of rollouts on the watched rows, without gradient."""
        return evaluated(self._model, self._evaluation, runs)

    def measure(self, runs: Runs) -> LossSums:
        """The losses of training rollouts without dropout and gradient."""
        if self._measured is None:
            skip, rows = self._plan.rollout.skip, self._train_rows
            self._measured = scoring(self._model, self._series, skip, rows)
        return evaluated(self._model, self._measured, runs)


def _write(into: TorchScoring, series: Mapping[str, FloatArray]) -> None:
    for name, values in series.items():
        into.series[name].copy_(torch.from_numpy(values))


class KernelObjective:
    """Computes losses and gradient with a training kernel. Raises CompilerMissingError."""

    def __init__(
        self,
        model: TorchModel,
        plan: StagePlan,
        series: Mapping[str, FloatArray],
        train_rows: RowsByLoss | None,
        evaluation_rows: RowsByLoss | None,
    ) -> None:
        series = own_series(plan, series)
        self._model, self._plan, self._series = model, plan, series
        self._train_rows = train_rows
        self._measured: KernelData | None = None
        self._kernel = Kernel(plan.program, plan.dtype, plan.threads)
        self.has_infinite_slopes = self._kernel.source.has_infinite_slopes
        self._train = self._kernel.data(own_series(plan, series), plan.rollout.skip, train_rows)
        self._evaluation = self._kernel.data(series, plan.rollout.skip, evaluation_rows)
        self._weights = [plan.loss_weights[name] for name in self._kernel.source.losses]
        self._grouped: tuple[Runs, Groups] | None = None

    def check(self, runs: Runs) -> None:
        """Compares a newly built kernel with the reference interpreter. Raises WrongKernelError."""
        kernel, weights = self._kernel, self._model.weights()
        check_if_fresh(kernel.built, lambda: check_kernel(kernel, self._series, runs, weights))

    def write(self, series: Mapping[str, FloatArray], *, watched: bool = False) -> None:
        """Replaces series that training or watched rollouts read (see `own_series`)."""
        (self._evaluation if watched else self._train).write(series)
        if not watched:
            measured = without_masks(self._plan, series)
            self._series |= measured
            if self._measured is not None:
                self._measured.write(measured)

    def scored(self, runs: Runs) -> Scored:
        """The losses of training rollouts."""
        losses: LossSums = {}
        physical = self._physical()
        total = _KernelTotal.apply(physical, self, self._train, runs, losses)
        assert isinstance(total, Tensor)
        return Scored(total, losses)

    def evaluate(self, runs: Runs) -> LossSums:
        """The losses of rollouts on the watched rows, without gradient."""
        return self._evaluated(self._evaluation, runs)

    def measure(self, runs: Runs) -> LossSums:
        """The losses of training rollouts without dropout and gradient."""
        if self._measured is None:
            skip, rows = self._plan.rollout.skip, self._train_rows
            self._measured = self._kernel.data(self._series, skip, rows)
        return self._evaluated(self._measured, runs)

    def _evaluated(self, data: KernelData, runs: Runs) -> LossSums:
        losses: LossSums = {}
        with torch.no_grad():
            self.value_and_slope(self._physical(), data, runs, losses, slope=False)
        return losses

    def value_and_slope(
        self, physical: Tensor, data: KernelData, runs: Runs, losses: LossSums, *, slope: bool
    ) -> tuple[float, FloatArray]:
        """The weighted total and its gradient in physical parameters; fills in `losses`."""
        kernel = self._kernel
        found = kernel.losses(
            data,
            self._groups(runs),
            physical.detach().to(torch.float64).numpy(),
            self._weights,
            gradient=slope,
            ranks=self._plan.ranks,
        )
        measures = _measures(self._plan)
        for name, total, count in zip(
            kernel.source.losses, found.sums.tolist(), found.counts.tolist(), strict=True
        ):
            losses[name] = LossSum(total, count)
        # a root is taken of the sums over all groups and ranks, never of parts
        value = sum(
            weight * losses[name].value(measures[name])
            for name, weight in self._plan.loss_weights.items()
        )
        return value, found.gradient

    def _groups(self, runs: Runs) -> Groups:
        """The groups of rollouts, cached because a line search evaluates the same ones
        repeatedly.
        """
        if self._grouped is None or self._grouped[0] is not runs:
            self._grouped = runs, self._kernel.groups(runs.t0, runs.steps)
        return self._grouped[1]

    def _physical(self) -> Tensor:
        values = self._model.physical()
        return torch.cat([values[p.name].reshape(-1) for p in self._plan.program.parameters])


class _KernelTotal(torch.autograd.Function):
    """A kernel's weighted total; the forward pass also computes the gradient."""

    @staticmethod
    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]  (torch's way)
        ctx: Any,
        physical: Tensor,
        objective: KernelObjective,
        data: KernelData,
        runs: Runs,
        losses: LossSums,
    ) -> Tensor:
        value, gradient = objective.value_and_slope(physical, data, runs, losses, slope=True)
        # the kernel gives value and slope in one pass: what backward asks for is there already
        ctx.save_for_backward(torch.from_numpy(gradient).to(physical.dtype))
        return physical.new_tensor(value)

    @staticmethod
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]  (torch's way)
        ctx: Any, grad: Tensor
    ) -> tuple[Tensor | None, ...]:
        (gradient,) = ctx.saved_tensors
        # the gradient is that of the weighted total: what follows it in torch can only scale it
        return (grad * gradient, None, None, None, None)


def _measures(plan: StagePlan) -> dict[str, Measure]:
    return {loss.name: loss.measure for loss in plan.program.losses}
