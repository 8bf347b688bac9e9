"""Writes arrays and text as a safetensors file; the same content gives the same bytes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TYPES = {np.dtype(np.float64): "F64", np.dtype(np.float32): "F32", np.dtype(np.int64): "I64"}


def safetensors_bytes(arrays: Mapping[str, NDArray[Any]], metadata: Mapping[str, str]) -> bytes:
    """The content of a safetensors file with arrays and texts (`metadata`), both by name. The same
    arguments give the same bytes; the library's own writer has a random order of metadata.

    The format starts with eight bytes for the length of the header and the header as JSON, padded
    to a multiple of eight. After it come the elements of each array in C order, little endian
    (huggingface.co/docs/safetensors, "Format"). Raises KeyError for a dtype other than float64,
    float32 and int64.
    """
    header: dict[str, Any] = {"__metadata__": dict(sorted(metadata.items()))}
    parts: list[bytes] = []
    start = 0
    for name in sorted(arrays):
        array = arrays[name]
        data = array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes(order="C")
        header[name] = {
            "dtype": _TYPES[array.dtype],
            "shape": list(array.shape),
            "data_offsets": [start, start + len(data)],
        }
        parts.append(data)
        start += len(data)
    text = json.dumps(header, ensure_ascii=False, separators=(",", ":")).encode()
    # aligns the data, so that files can be mapped into memory
    text += b" " * (-len(text) % 8)
    return b"".join([len(text).to_bytes(8, "little"), text, *parts])
