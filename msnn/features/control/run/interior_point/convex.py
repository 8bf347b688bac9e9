"""Projects Hessians onto convex ones, since a step along negative curvature would diverge."""

from __future__ import annotations

import numpy as np

from msnn.features.control.problem.optimal_control.horizon import Array


def convex(hessian: Array) -> Array:
    """The nearest symmetric matrices without negative curvature."""
    values, vectors = np.linalg.eigh(hessian)
    # flat directions count as bent a little: their step would be endless
    least = 1e-8 * np.maximum(1.0, np.max(np.abs(values), axis=1, keepdims=True))
    return np.einsum("kij,kj,klj->kil", vectors, np.maximum(values, least), vectors)
