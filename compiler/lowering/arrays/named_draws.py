"""Draws random initial values from the name of an array, the same on every machine."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def uniform_draws(name: str, low: float, high: float, shape: Sequence[int], draw: int = 0) -> Array:
    """Uniform random values in [low, high).

    The scaling is written out, since some compilers fuse multiplication and addition in numpy's
    own.
    """
    return low + (high - low) * generator_of(name, draw).random(tuple(shape))


def generator_of(name: str, draw: int = 0) -> np.random.Generator:
    """A counter-based generator (Philox; Salmon et al. 2011), seeded by the array's name and
    `draw`.

    A name of a spec has no space, so the key `name draw` cannot collide with another name.
    """
    digest = hashlib.sha256((f"{name} {draw}" if draw else name).encode()).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest[:8], "little")))
