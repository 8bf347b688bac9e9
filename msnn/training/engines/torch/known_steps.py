"""Handles priors, penalties and decay of raw tensors, in addition to the losses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from backends.known_terms import approached
from backends.torch_module.module import physical_value
from compiler.ir.program import Parameter
from msnn.data.dataset import FloatArray
from msnn.training.plans.known_terms_of_stage import known_of
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.sections.optimizers import Adam, AdamW, Lbfgs, Sgd


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
    """Proximal steps for optimisers with a known step size; differentiable terms for the others."""

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
        """The proximal step after an optimiser step, in float64 like in kernels."""
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
