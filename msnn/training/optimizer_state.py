"""An optimiser's nested state as named arrays and JSON, for files that hold no code."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from msnn.training.engine import EngineState


def flattened(content: dict[str, Any]) -> EngineState:
    """Tensors become arrays named by their path; the rest becomes JSON that refers to them."""
    arrays: dict[str, Any] = {}
    structure = _encoded(content, "", arrays)
    return EngineState(arrays, structure)


def rebuilt(state: EngineState) -> dict[str, Any]:
    """The content that `flattened` was given; raises KeyError or ValueError for anything else."""
    content = _decoded(state.structure, state)
    if not isinstance(content, dict):
        message = "an engine state is a mapping"
        raise ValueError(message)
    return content


def _encoded(value: Any, path: str, arrays: dict[str, Any]) -> Any:
    match value:
        case Tensor():
            arrays[path] = value.detach().cpu().numpy().copy()
            return {"array": path}
        case dict():
            entries = [
                [key, _encoded(part, f"{path}/{key}", arrays)] for key, part in value.items()
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
