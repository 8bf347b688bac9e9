"""Provides objectives for torch optimisers: losses, priors, penalties and weight decay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from backends.known_terms import approached
from backends.native.kernel import Kernel
from backends.native.kernel_data import Groups, KernelData
from backends.torch_module.module import TorchModel, physical_value
from compiler.differentiation.training_step import training_step
from compiler.ir.program import Measure, Parameter
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.engines.kernel_check import check_if_fresh, check_kernel
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import LossSums, own_series, without_masks
from msnn.training.engines.torch.torch_losses import TorchScoring, batch_losses, evaluated, scoring
from msnn.training.plans.loss_terms import known_of
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.sections.optimizers import Adam, AdamW, Lbfgs, Sgd

RowsByLoss = Mapping[str, BoolArray]


@dataclass(frozen=True, slots=True)
class Scored:
    """The result for one batch: the weighted total, a tensor with gradients in the raw variables,
    and each loss.
    """

    total: Tensor
    losses: LossSums


class TorchObjective:
    """An objective that simulates the rollouts in torch and differentiates them by autograd."""

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
        """Overwrites the series that the stage changes: dropout factors and initial states
        (`own_series`).

        They are read by the rollouts of the monitor if `watched`, else by those of training.
        """
        _write(self._evaluation if watched else self._train, series)
        if not watched:
            measured = without_masks(self._plan, series)
            self._series |= measured
            if self._measured is not None:
                _write(self._measured, measured)

    def scored(self, runs: Runs) -> Scored:
        """The total and the losses of a batch of training rollouts, with gradients."""
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
        """The losses of rollouts on the rows of the monitor's set, without gradient."""
        return evaluated(self._model, self._evaluation, runs)

    def measure(self, runs: Runs) -> LossSums:
        """The losses of training rollouts without dropout, as sums and counts, without gradient."""
        if self._measured is None:
            skip, rows = self._plan.rollout.skip, self._train_rows
            self._measured = scoring(self._model, self._series, skip, rows)
        return evaluated(self._model, self._measured, runs)


def _write(into: TorchScoring, series: Mapping[str, FloatArray]) -> None:
    for name, values in series.items():
        into.series[name].copy_(torch.from_numpy(values))


class KernelObjective:
    """An objective whose losses and gradient come from a training kernel, for optimisers of torch.

    Raises CompilerMissingError if there is no C compiler.
    """

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
        """Overwrites the series that the stage changes: dropout factors and initial states
        (`own_series`).
        """
        (self._evaluation if watched else self._train).write(series)
        if not watched:
            measured = without_masks(self._plan, series)
            self._series |= measured
            if self._measured is not None:
                self._measured.write(measured)

    def scored(self, runs: Runs) -> Scored:
        """The total and the losses of a batch of training rollouts, with gradients."""
        losses: LossSums = {}
        physical = self._physical()
        total = _KernelTotal.apply(physical, self, self._train, runs, losses)
        assert isinstance(total, Tensor)
        return Scored(total, losses)

    def evaluate(self, runs: Runs) -> LossSums:
        """The losses of rollouts on the rows of the monitor's set, without gradient."""
        return self._evaluated(self._evaluation, runs)

    def measure(self, runs: Runs) -> LossSums:
        """The losses of training rollouts without dropout, as sums and counts, without gradient."""
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
        """The weighted total of a batch and, if `slope`, its gradient with respect to physical
        parameters.

        `physical` has all elements in one vector. `losses` is filled with the value of each loss.
        """
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


def prior_total(plan: StagePlan, raws: Mapping[str, Tensor], spread: float) -> Tensor:
    """ŝ²/n · Σ ((p − mean)/std)² of the trained parameters, differentiable."""
    found: list[Tensor] = []
    for name, raw in raws.items():
        parameter = plan.program.parameter(name)
        if parameter.prior is not None:
            value = physical_value(parameter, raw)
            found.append((((value - parameter.prior.mean) / parameter.prior.std) ** 2).sum())
    return spread * torch.stack(found).sum()


class KnownSteps:
    """Adds priors, penalties and weight decay to the steps of an optimiser of torch.

    If the step size of the optimiser is known, each step is followed by a proximal step. Otherwise
    these terms are added to the loss, as far as they have derivatives.
    """

    def __init__(self, plan: StagePlan, parameters: Sequence[Parameter]) -> None:
        self._terms = known_of(plan, parameters)
        self._plan, self._choice = plan, plan.optimizer
        self._takes_steps = plan.optimizer.reaches_corners and not self._terms.is_empty

    def terms(self, raws: Mapping[str, Tensor], spread: float) -> Tensor | float:
        """The differentiable terms added to the losses; 0 if proximal steps follow instead."""
        total: Tensor | float = 0.0
        if self._terms.has_priors and not self._takes_steps:
            total = prior_total(self._plan, raws, spread)
        decay = self._plan.weight_decay
        if decay and isinstance(self._choice, Lbfgs):  # torch's knows of none
            total += 0.5 * decay * torch.stack([raw.square().sum() for raw in raws.values()]).sum()
        return total

    def follow(
        self, raws: Mapping[str, Tensor], optimizer: torch.optim.Optimizer, spread: float
    ) -> None:
        """Takes the proximal step for priors and penalties after a step of the optimiser; changes
        `raws`.

        It is computed in float64, as kernels do; does nothing for optimisers of unknown step size.
        """
        if not self._takes_steps:
            return
        tensors = [raws[parameter.name] for parameter in self._terms.parameters]
        lengths = self._lengths(optimizer)
        steps = [lengths[tensor] for tensor in tensors]
        raw = np.concatenate([_numbers(tensor) for tensor in tensors])
        reached = approached(self._terms, raw, np.concatenate(steps), spread)
        parts = np.split(reached, np.cumsum([tensor.numel() for tensor in tensors])[:-1])
        with torch.no_grad():
            for tensor, part in zip(tensors, parts, strict=True):
                tensor.copy_(torch.from_numpy(part.reshape(tensor.shape)))

    def _lengths(self, optimizer: torch.optim.Optimizer) -> dict[Tensor, FloatArray]:
        """The effective step size of each element in this step, for a constant gradient."""
        found: dict[Tensor, FloatArray] = {}
        for group in optimizer.param_groups:
            rate = float(group["lr"])
            for tensor in group["params"]:
                state = optimizer.state[tensor]
                match self._choice:
                    case Adam(beta2=beta2, eps=eps) | AdamW(beta2=beta2, eps=eps):
                        count = float(state["step"])
                        size = np.sqrt(_numbers(state["exp_avg_sq"]) / (1.0 - beta2**count)) + eps
                        found[tensor] = rate / size
                    case Sgd(momentum=momentum):
                        kept = 1.0 - momentum
                        share = 1.0 / kept if kept else 1.0
                        found[tensor] = np.full(tensor.numel(), rate * share)
                    case _:
                        raise AssertionError("others follow the slopes of priors")
        return found


def _numbers(tensor: Tensor) -> FloatArray:
    return tensor.detach().to("cpu", torch.float64).numpy().ravel()
