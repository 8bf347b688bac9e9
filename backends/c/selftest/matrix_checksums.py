"""Hashes the bits of a Jacobian: all entries of many steps would be long files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

START, _FACTOR = 2166136261, 16777619
"""Of FNV-1a in 32 bits (Fowler, Noll, Vo 1991)."""


def checksums(matrices: Mapping[str, NDArray[Any]]) -> list[int]:
    """FNV-1a of the words of all matrices (steps, rows, columns) in float32, for each step.

    Entries go in the order of the struct; one NaN is as good as another.
    """
    steps = len(next(iter(matrices.values())))
    parts = [matrix.reshape(steps, -1) for matrix in matrices.values()]
    entries = np.concatenate(parts, axis=1).astype(np.float32)
    entries[np.isnan(entries)] = np.float32(np.nan)
    hashes = np.full(steps, START, np.uint64)
    for word in entries.view(np.uint32).astype(np.uint64).T:
        hashes = ((hashes ^ word) * np.uint64(_FACTOR)) & np.uint64(0xFFFFFFFF)
    return [int(value) for value in hashes]
