"""Inverts a curvature on its identifiable subspace, and names unidentifiable directions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray

_NOTHING = 1e-10
"""Curvature, relative to that of single parameters, below which a direction is unidentifiable."""

_SHARE = 1e-3
"""Minimum component with which an element is named as part of an unidentifiable direction."""


def inverted(
    curvature: FloatArray, equations: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Pseudo-inverse on the identifiable subspace, and a basis of its null space as columns.

    Variables are first scaled to curvature 1, so that the rank does not depend on units. If
    `equations` are given, they are inverted on the subspace that the curvature identifies. Raises
    LinAlgError if they are singular there.
    """
    diagonal = np.diagonal(curvature)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(curvature * np.outer(scale, scale))
    seen = values > _NOTHING
    kept = vectors[:, seen] * scale[:, None]
    if equations is None:
        return (kept / values[seen]) @ kept.T, vectors[:, ~seen]
    within = kept.T @ equations @ kept
    # a robust loss may have no curvature where its squares have some
    if within.size and np.linalg.cond(within) > 1.0 / _NOTHING:
        raise np.linalg.LinAlgError
    return kept @ np.linalg.solve(within, kept.T), vectors[:, ~seen]


def is_part_of(nothing: FloatArray) -> BoolArray:
    """The mask of elements that take part in an unidentifiable direction."""
    return np.asarray((nothing * nothing).sum(axis=1) > _SHARE * _SHARE)


def combinations(
    curvature: FloatArray, nothing: FloatArray, names: list[str]
) -> tuple[Mapping[str, float], ...]:
    """The unidentifiable directions, in the units of the parameters."""
    diagonal = np.diagonal(curvature)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    found: list[Mapping[str, float]] = []
    for column in nothing.T:
        kept = np.abs(column) > _SHARE
        change = np.where(kept, column * scale, 0.0)
        change = change / change[np.argmax(np.abs(change))]
        found.append({names[i]: float(change[i]) for i in np.flatnonzero(kept)})
    return tuple(found)


def number_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """`k`, or `k[0]`, `k[1]`, … for the elements of an array."""
    if not shape:
        return [name]
    return [f"{name}[{', '.join(map(str, index))}]" for index in np.ndindex(shape)]
