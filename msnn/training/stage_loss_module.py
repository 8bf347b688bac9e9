"""Provides a stage's loss as a torch module for user-written training loops."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import torch
from torch import Tensor, nn

from backends.files.c_compiler import CompilerMissingError
from backends.torch_module.module import build_module
from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.data.rollout_rows import Runs
from msnn.errors.learning import training as errors
from msnn.training.engines.devices import CPU, Device, on_device
from msnn.training.engines.engine import LossSums, batches_of, factors_of
from msnn.training.engines.native.native_engine import try_natively
from msnn.training.engines.torch.objectives import KernelObjective, TorchObjective, prior_total
from msnn.training.plans.epochs import order_key, shuffled
from msnn.training.plans.loss_terms import has_priors, residuals_of
from msnn.training.plans.stage_data import StageData, stage_data, with_default_weights
from msnn.training.plans.stage_plan import StagePlan, plan_stages, with_slopes_alone
from msnn.training.stages.monitor import loss_values, monitor
from msnn.training.stages.stage_starts import stage_starts
from msnn.training.starts.data_scales import with_data_scales
from msnn.training.starts.initial_weights import first_weights
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.sections.training import Stage


def stage_loss(
    program: Program,
    data: Dataset,
    stages: Sequence[Stage],
    number: int,
    weights: Mapping[str, FloatArray] | None,
    device: Device = CPU,
) -> StageLoss:
    """The loss of stage `number`, from 0, at the given weights, by default the initial ones.

    Raises SpecError if stages and data do not fit, IndexError if there is no such stage.
    """
    findings = Findings()
    plans = on_device(plan_stages(program, stages, findings), device, findings)
    findings.raise_errors()
    # raised before: plans of a faulty spec have no rollouts to look for in the data
    runs = stage_data(plans[number], data, findings)
    findings.raise_errors()
    assert runs is not None
    first = first_weights(program, data) if weights is None else weights
    return StageLoss(
        with_data_scales(with_default_weights(plans, data), data, first)[number], data, runs, first
    )


class StageLoss(nn.Module):
    """The weighted total of one stage for a batch of rollouts; backward uses the kernel.

    The module's parameters are raw variables; those of the stage have a gradient. With `engine:
    auto` the loss is unrolled in torch if there is no C compiler or no correct kernel; `notes`
    report this. Raises SpecError if `engine: native` is not possible.
    """

    def __init__(
        self, plan: StagePlan, data: Dataset, runs: StageData, weights: Mapping[str, FloatArray]
    ) -> None:
        super().__init__()
        # the loop outside takes steps by slopes, whatever the stage would do in corners
        self.plan = plan = with_slopes_alone(plan)
        self._spread: float | None = None
        self._data, self._runs = data, runs
        # given back bit for bit: through a raw variable and a float32 they would come back rounded
        self._fixed = {n: value for n, value in weights.items() if n not in plan.trained}
        self.notes: tuple[Diagnostic, ...] = ()
        """Notes for the user about the engine."""
        self._model = build_module(plan.program, getattr(torch, plan.dtype), plan.device)
        # before gradients are asked for: what is loaded is no step
        self._model.load_physical(weights, plan.trained)
        for parameter in plan.program.parameters:
            self._model.raw(parameter.name).requires_grad_(parameter.name in plan.trained)
        self._objective = self._opened()
        # its warnings are those of a training, which this is not
        self._starts = stage_starts(plan, data, runs, lambda _: None)
        self._sums: LossSums = {}

    def _opened(self) -> KernelObjective | TorchObjective:
        plan, runs = self.plan, self._runs
        arguments = (self._model, plan, self._data.series, runs.train_rows, runs.watched_rows)

        def native(_: StagePlan) -> KernelObjective:
            objective = KernelObjective(*arguments)
            objective.check(runs.train)
            return objective

        if plan.engine != "torch":
            try:
                # parameters have the stage's precision already, so that there is no other to try
                tried = try_natively(plan, native, in_double=False)
                self.notes = tried.notes
                if tried.made is not None:
                    return tried.made
            except CompilerMissingError as error:
                if plan.engine == "native":
                    found = errors.no_native_engine(plan.name, str(error), plan.span)
                    raise SpecError((found,)) from None
        return TorchObjective(*arguments)

    def batches(self, epoch: int) -> Iterator[Runs]:
        """The batches of an epoch, from 0, shuffled and with dropout as in the stage."""
        plan = self.plan
        self._objective.write(factors_of(plan, self._data.series, epoch))
        if has_priors(plan):
            # once an epoch, as in training: measured by each batch it would be noise itself
            self._spread = self._measured(epoch)
        runs = self._runs.in_epoch(epoch)
        if self._starts is not None:
            self._objective.write(self._starts.for_training(runs, self.weights()))
        # the stage's own order: a loop like that of `train` sees the same batches
        order = shuffled(len(runs), order_key(plan.seed, plan.index, epoch))
        yield from batches_of(runs.take(order), plan.batch or len(order))

    def forward(self, batch: Runs) -> Tensor:
        """The weighted total of a batch, differentiable in `parameters()`."""
        found = self._objective.scored(batch)
        self._sums = found.losses
        return found.total + self._priors()

    def _priors(self) -> Tensor | float:
        if not has_priors(self.plan):
            return 0.0
        # a loop may ask for the loss before it asks for batches
        if self._spread is None:
            self._spread = self._measured(0)
        raws = {name: self._model.raw(name) for name in self.plan.trained}
        return prior_total(self.plan, raws, self._spread)

    def _measured(self, epoch: int) -> float:
        """ŝ²/n of the rollouts of an epoch, the weight of priors."""
        runs = self._runs.in_epoch(epoch)
        return residuals_of(self.plan, self._objective.measure(runs), runs).spread

    @property
    def losses(self) -> dict[str, float]:
        """Each loss of the last batch, unweighted."""
        return loss_values(self.plan, self._sums)

    def monitor(self) -> float:
        """The monitor at the current weights, which selects the best weights of the stage."""
        if self._starts is not None:
            found = self._starts.for_watching(self._runs.watched, self.weights())
            self._objective.write(found, watched=True)
        return monitor(self.plan, self._objective.evaluate, self._runs, self.weights)

    def weights(self) -> dict[str, FloatArray]:
        """Physical values of all parameters, in the form for `validate`, `export` and weights
        files.
        """
        return {**self._model.weights(), **self._fixed}
