"""Adds to least squares what a stage knows beside the data, as quadratics of its raw variables.

Weight decay λ is λ/2 · Σ raw², whose slope λ · raw is what the other optimisers add to theirs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray


@dataclass(frozen=True, slots=True)
class QuadraticTerms:
    """Terms near some raw variables: value + 2 slopeᵀδ + Σ curvature · δ²."""

    value: float
    slope: FloatArray
    curvature: FloatArray


def quadratic_terms(raw: FloatArray, decay: float) -> QuadraticTerms:
    """The terms at these raw variables."""
    half = 0.5 * decay
    return QuadraticTerms(
        value=half * float(raw @ raw),
        slope=half * raw,
        curvature=np.full_like(raw, half),
    )
