"""Optimisers of `torch.optim` by their names: which there are, and what they accept."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import torch

from compiler.program import Parameter
from spec_schema.diagnostics import Findings
from spec_schema.errors import stages as errors
from spec_schema.optimizers import TorchOptimizer

_OTHERS = {
    "LBFGS": "`lbfgs: {}` is that with a line search",
    "SparseAdam": "it takes sparse gradients, and those of models here are dense",
}
"""Optimisers that do not step along a dense gradient by themselves."""
_OURS = frozenset(
    {"params", "weight_decay", "maximize", "foreach", "fused", "capturable", "differentiable"}
)
"""Arguments that are no matter of a spec: the stage has its own key, or an engine decides."""


def check_torch_optimizer(
    optimizer: TorchOptimizer,
    weight_decay: float,
    trained: Iterable[Parameter],
    findings: Findings,
) -> float:
    """The learning rate; what torch would refuse goes to `findings`."""
    name, known = optimizer.name, _optimizers()
    if name.value not in known:
        why = _OTHERS.get(name.value)
        findings.report(errors.unknown_torch_optimizer(name.value, name.span, known, why))
        return 1.0
    accepted = _options(known[name.value])
    wrong = [option for option in optimizer.options if option not in accepted]
    for option in wrong:
        span = optimizer.options[option].key or name.span
        findings.report(errors.unknown_torch_option(option, name.value, span, tuple(accepted)))
    decays = "weight_decay" in inspect.signature(known[name.value]).parameters
    if weight_decay and not decays:
        findings.report(errors.no_weight_decay(name.value, name.span))
    shapes = [tuple(axis.size for axis in parameter.axes) for parameter in trained]
    if not shapes or wrong or (weight_decay and not decays):
        return 1.0
    variables = [torch.zeros(shape, requires_grad=True) for shape in shapes]
    try:
        made = torch_optimizer(optimizer, [{"params": variables}], weight_decay)
        for variable in variables:
            variable.grad = torch.ones_like(variable)
        made.step()
    except (TypeError, ValueError, RuntimeError, IndexError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        findings.report(errors.refused_by_torch(name.value, reason, name.span))
        return 1.0
    return float(made.param_groups[0]["lr"])


def torch_optimizer(
    optimizer: TorchOptimizer, groups: list[dict[str, Any]], weight_decay: float
) -> torch.optim.Optimizer:
    """The optimiser, one step of which follows the gradients of the groups."""
    made = _optimizers()[optimizer.name.value]
    known = inspect.signature(made).parameters
    options: dict[str, Any] = {name: found.value for name, found in optimizer.options.items()}
    if "weight_decay" in known:
        options["weight_decay"] = weight_decay
    if "foreach" in known:
        options["foreach"] = False  # models are small, and one order of steps is one result
    return made(groups, **options)


def torch_optimizer_names() -> tuple[str, ...]:
    """The optimisers that this version of torch has for models."""
    return tuple(_optimizers())


@cache
def _optimizers() -> Mapping[str, type[torch.optim.Optimizer]]:
    """By name, those of this version of torch: a name reaches nothing else."""
    found = {name: getattr(torch.optim, name) for name in sorted(dir(torch.optim))}
    return {
        name: kind
        for name, kind in found.items()
        if inspect.isclass(kind)
        and issubclass(kind, torch.optim.Optimizer)
        and kind is not torch.optim.Optimizer
        and name not in _OTHERS
    }


def _options(kind: type[torch.optim.Optimizer]) -> list[str]:
    return [name for name in inspect.signature(kind).parameters if name not in _OURS]
