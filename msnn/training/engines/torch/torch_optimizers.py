"""Constructs optimisers of `torch.optim` by name."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from typing import Any

import torch

from compiler.ir.program import Parameter
from msnn.errors.learning import stages as errors
from msnn.training.plans.torch_optimizer_options import TORCH_OPTIMIZERS
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.sections.optimizers import TorchOptimizer


def try_torch_optimizer(
    optimizer: TorchOptimizer,
    weight_decay: float,
    trained: Iterable[Parameter],
    findings: Findings,
) -> None:
    """Constructs the optimiser and takes one step; errors of this torch version go to `findings`.

    The check of the spec leaves few of them: incompatible options, or a class that is too new.
    """
    name = optimizer.name
    if name.value not in torch_optimizer_names():
        known = torch_optimizer_names()
        why = f"torch {torch.__version__} does not have it"
        findings.report(errors.unknown_torch_optimizer(name.value, name.span, known, why))
        return
    shapes = (tuple(axis.size for axis in parameter.axes) for parameter in trained)
    variables = [torch.zeros(shape, requires_grad=True) for shape in shapes]
    try:
        made = torch_optimizer(optimizer, [{"params": variables}], weight_decay)
        for variable in variables:
            variable.grad = torch.ones_like(variable)
        made.step()
    except (TypeError, ValueError, RuntimeError, IndexError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        findings.report(errors.refused_by_torch(name.value, reason, name.span))


def torch_optimizer(
    optimizer: TorchOptimizer, groups: list[dict[str, Any]], weight_decay: float
) -> torch.optim.Optimizer:
    """The optimiser; one step uses the gradients of the groups."""
    assert optimizer.name.value in TORCH_OPTIMIZERS, "a name reaches nothing else of torch"
    made = getattr(torch.optim, optimizer.name.value)
    known = inspect.signature(made).parameters
    options: dict[str, Any] = {name: found.value for name, found in optimizer.options.items()}
    if "weight_decay" in known:
        options["weight_decay"] = weight_decay
    if "foreach" in known:
        options["foreach"] = False  # models are small, and one order of steps is one result
    return made(groups, **options)


def torch_optimizer_names() -> tuple[str, ...]:
    """The optimisers for models in the installed version of torch."""
    return tuple(name for name in TORCH_OPTIMIZERS if hasattr(torch.optim, name))
