"""Constructs optimisers of `torch.optim` by name, and stores their state as arrays and JSON."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Sequence
from typing import Any, cast

import torch
from torch import Tensor

from compiler.ir.program import Parameter
from msnn.errors.learning import stages as errors
from msnn.training.engines.engine import EngineState
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


def flattened(content: dict[str, Any]) -> EngineState:
    """Converts tensors to arrays named by their path, and the rest to JSON that refers to them."""
    arrays: dict[str, Any] = {}
    structure = _encoded(content, "", arrays)
    return EngineState(arrays, structure)


def rebuilt(state: EngineState) -> dict[str, Any]:
    """The inverse of `flattened`; raises KeyError or ValueError for any other state."""
    content = _decoded(state.structure, state)
    if not isinstance(content, dict):
        message = "an engine state is a mapping"
        raise ValueError(message)
    return content


def placed_like(kept: Any, loaded: Any) -> Any:
    """The same content with each tensor on the device of its counterpart in `loaded`."""
    match kept:
        case Tensor():
            return kept.to(loaded.device)
        case dict():
            content = cast("dict[Any, Any]", kept)
            return {key: placed_like(part, loaded[key]) for key, part in content.items()}
        case list() | tuple():
            parts = cast("Sequence[Any]", kept)
            found = [placed_like(*pair) for pair in zip(parts, loaded, strict=True)]
            return tuple(found) if isinstance(kept, tuple) else found
        case _:
            return kept


def _encoded(value: Any, path: str, arrays: dict[str, Any]) -> Any:
    match value:
        case Tensor():
            arrays[path] = value.detach().cpu().numpy().copy()
            return {"array": path}
        case dict():
            entries = [
                # pairs, no object: keys of optimisers are integers, which JSON would make strings
                [key, _encoded(part, f"{path}/{key}", arrays)]
                for key, part in value.items()
            ]
            return {"mapping": entries}
        case list() | tuple():
            kind = "list" if isinstance(value, list) else "tuple"
            return {kind: [_encoded(p, f"{path}/{i}", arrays) for i, p in enumerate(value)]}
        case None | bool() | int() | float() | str():
            return {"value": value}
        case _:
            message = f"{path}: {type(value).__name__} cannot be kept"
            raise TypeError(message)


def _decoded(structure: Any, state: EngineState) -> Any:
    match structure:
        case {"array": str(path)}:
            return torch.from_numpy(state.arrays[path].copy())
        case {"mapping": list(entries)}:
            return {key: _decoded(part, state) for key, part in entries}
        case {"list": list(parts)}:
            return [_decoded(part, state) for part in parts]
        case {"tuple": list(parts)}:
            return tuple(_decoded(part, state) for part in parts)
        case {"value": value}:
            return value
        case _:
            message = "not an engine state"
            raise ValueError(message)
