"""Stores an optimiser's nested state as arrays and JSON, which cannot contain code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import torch
from torch import Tensor

from msnn.training.engines.engine import EngineState


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
