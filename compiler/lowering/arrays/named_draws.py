"""Random numbers for initial values: different for every array, the same on every machine."""

from __future__ import annotations

import hashlib

import numpy as np


def generator_of(name: str, draw: int = 0) -> np.random.Generator:
    """A counter-based generator (Philox; Salmon et al. 2011) keyed by an array's name.

    Another `draw` is another generator for each array. No name of a spec has a space.
    """
    digest = hashlib.sha256((f"{name} {draw}" if draw else name).encode()).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest[:8], "little")))
