"""Reads the arrays of a safetensors file, which may come from anywhere."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray


def arrays_in(content: bytes) -> dict[str, NDArray[Any]] | None:
    """The arrays by name; None where the bytes are not those of a safetensors file."""
    # only here: most commands read no weights
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        return load(content)
    # KeyError of a dtype that numpy does not have
    except (SafetensorError, ValueError, KeyError):
        return None
