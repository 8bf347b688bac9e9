"""Adds to least squares what a stage knows beside the data, as quadratics of its raw variables.

Weight decay λ is λ/2 · Σ raw², whose slope λ · raw is what the other optimisers add to theirs. A
prior is ŝ²/n · ((p − mean)/std)², the square of one more residual of the physical value p.
"""

from __future__ import annotations

from dataclasses import dataclass

from backends.known_terms import KnownTerms, deviations
from msnn.data.dataset import FloatArray


@dataclass(frozen=True, slots=True)
class QuadraticTerms:
    """Terms near some raw variables: value + 2 slopeᵀδ + Σ curvature · δ²."""

    value: float
    slope: FloatArray
    curvature: FloatArray


def quadratic_terms(
    known: KnownTerms, raw: FloatArray, decay: float, spread: float
) -> QuadraticTerms:
    """The terms at these raw variables; priors count by `spread`, ŝ²/n."""
    half = 0.5 * decay
    away, steep = deviations(known, raw)
    return QuadraticTerms(
        value=half * float(raw @ raw) + spread * float(away @ away),
        slope=half * raw + spread * away * steep,
        curvature=half + spread * steep * steep,
    )
