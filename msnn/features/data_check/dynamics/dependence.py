"""Finds inputs that are linear combinations of other inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.features.data_check.dynamics.pieces import Piece

LEAST_SHARE = 0.99
"""Fraction of an input's variance above which standard errors increase tenfold, by 1/√(1 − R²)."""
_NAMED = 0.05


@dataclass(frozen=True, slots=True)
class Dependence:
    """Input `number` ≈ Σ factor · input, with the coefficient of determination `share`."""

    number: int
    share: float
    factors: tuple[tuple[int, float], ...]
    """The other inputs with their factors, in the units of both."""


def dependences(pieces: Sequence[Piece]) -> tuple[Dependence, ...]:
    """The inputs determined by others in the same row; of each group, all but the first."""
    if not pieces:
        return ()
    table = np.concatenate([piece.inputs for piece in pieces])
    # an input that stands still depends on nothing
    deviation = np.std(table, axis=0)
    moving = np.flatnonzero(deviation > 0)
    # three rows a number, or any table is a combination of others
    if len(moving) < 2 or len(table) < 3 * len(moving):
        return ()
    scaled = (table[:, moving] - table[:, moving].mean(axis=0)) / deviation[moving]
    correlation = scaled.T @ scaled / len(scaled)
    found: list[Dependence] = []
    # the first one that moves is kept; each later one is compared with those kept
    kept = [0]
    for place in range(1, len(moving)):
        left, right = correlation[np.ix_(kept, kept)], correlation[kept, place]
        factors: FloatArray = np.asarray(
            np.linalg.lstsq(left, right, rcond=1e-12)[0], dtype=np.float64
        )
        share = float(factors @ right)
        if share < LEAST_SHARE:
            kept.append(place)
            continue
        named = [
            (
                int(moving[other]),
                float(factor * deviation[moving[place]] / deviation[moving[other]]),
            )
            for other, factor in zip(kept, factors.tolist(), strict=True)
            if abs(factor) > _NAMED
        ]
        found.append(Dependence(int(moving[place]), min(share, 1.0), tuple(named)))
    return tuple(found)
