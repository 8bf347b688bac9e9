"""Draws initial values by an array's name: different for each, the same on every machine."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def uniform_draws(name: str, low: float, high: float, shape: Sequence[int], draw: int = 0) -> Array:
    """Uniform numbers between two; numpy's own way to scale them is fused by some compilers."""
    return low + (high - low) * generator_of(name, draw).random(tuple(shape))


def generator_of(name: str, draw: int = 0) -> np.random.Generator:
    """A counter-based generator (Philox; Salmon et al. 2011) keyed by an array's name.

    Another `draw` is another generator for each array. No name of a spec has a space.
    """
    digest = hashlib.sha256((f"{name} {draw}" if draw else name).encode()).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest[:8], "little")))
