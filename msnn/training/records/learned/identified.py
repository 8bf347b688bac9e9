"""Inverts a curvature where it is not flat, and names the directions that change nothing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray

_NOTHING = 1e-10
"""Curvature, relative to that of single parameters, below which a direction changes nothing."""

_SHARE = 1e-3
"""Part of a direction that changes nothing from which on a number is named as a part of it."""


def inverted(
    curvature: FloatArray, equations: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """The inverse in the directions that change something, and the others as columns.

    In variables that are scaled to curvature 1 each, so that units do not decide what is small.
    Where `equations` are given, these are inverted, and the curvature says what changes something.
    Raises LinAlgError where they are singular in what does.
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
    """The mask of numbers that have a part in a direction that changes nothing."""
    return np.asarray((nothing * nothing).sum(axis=1) > _SHARE * _SHARE)


def combinations(
    curvature: FloatArray, nothing: FloatArray, names: list[str]
) -> tuple[Mapping[str, float], ...]:
    """The directions that change nothing, in the parameters' own units."""
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
