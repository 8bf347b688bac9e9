"""Hashes of Jacobians and states, since all entries of many steps would make long files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

START, _FACTOR, _DIGITS = 2166136261, 16777619, 15
"""FNV-1a in 32 bits (Fowler, Noll, Vo 1991), and a shift by which the hash is mixed after each
word. Without it the top bit affects no other bit, so that two changed signs would cancel."""


def checksums(matrices: Mapping[str, NDArray[Any]]) -> list[int]:
    """Mixed FNV-1a of the words of all matrices (steps, …) in float32, for each step.

    Entries are in the order of the struct. All NaN are equal, as are both zeros: C omits terms that
    are 0, which affects the sign of zero sums.
    """
    steps = len(next(iter(matrices.values())))
    parts = [matrix.reshape(steps, -1) for matrix in matrices.values()]
    entries = np.concatenate(parts, axis=1).astype(np.float32)
    # processors differ in the sign and payload of NaN
    entries[np.isnan(entries)] = np.float32(np.nan)
    entries[entries == 0.0] = np.float32(0.0)
    hashes = np.full(steps, START, np.uint64)
    for word in entries.view(np.uint32).astype(np.uint64).T:
        hashes = ((hashes ^ word) * np.uint64(_FACTOR)) & np.uint64(0xFFFFFFFF)
        hashes ^= hashes >> np.uint64(_DIGITS)
    return [int(value) for value in hashes]
