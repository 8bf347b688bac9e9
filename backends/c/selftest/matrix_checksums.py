"""Hashes the bits of Jacobians and states: all entries of many steps would be long files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

START, _FACTOR, _DIGITS = 2166136261, 16777619, 15
"""Of FNV-1a in 32 bits (Fowler, Noll, Vo 1991), and by how many digits a hash is moved over itself
after each word: a product takes the topmost digit nowhere else, so that two changed signs would
cancel."""


def checksums(matrices: Mapping[str, NDArray[Any]]) -> list[int]:
    """FNV-1a, mixed, of the words of all matrices (steps, …) in float32, for each step.

    Entries go in the order of the struct; one NaN is as good as another, and so is one zero: C
    leaves out terms that are 0, and with them what they do to the sign of a sum that is 0.
    """
    steps = len(next(iter(matrices.values())))
    parts = [matrix.reshape(steps, -1) for matrix in matrices.values()]
    entries = np.concatenate(parts, axis=1).astype(np.float32)
    # processors differ in the sign and the payload of the NaN that they make
    entries[np.isnan(entries)] = np.float32(np.nan)
    entries[entries == 0.0] = np.float32(0.0)
    hashes = np.full(steps, START, np.uint64)
    for word in entries.view(np.uint32).astype(np.uint64).T:
        hashes = ((hashes ^ word) * np.uint64(_FACTOR)) & np.uint64(0xFFFFFFFF)
        hashes ^= hashes >> np.uint64(_DIGITS)
    return [int(value) for value in hashes]
