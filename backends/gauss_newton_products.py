"""Sums over rollouts what Gauss-Newton methods need of a loss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Products:
    """Products of the residuals r of one loss and of their slopes J in the learned numbers."""

    curvature: FloatArray
    """JᵀJ."""
    slope: FloatArray
    """Jᵀr."""
    squares: float
    """rᵀr; the cost itself but for huber."""
    cost: float
    """Σ of the loss over its elements."""
    count: float
    """Elements that are scored, each as often as the factor of its row says."""
    left_out: float = 0.0
    """Of these the ones without a share in the products, as their slopes are infinite."""

    def __add__(self, other: Products) -> Products:
        return Products(
            self.curvature + other.curvature,
            self.slope + other.slope,
            self.squares + other.squares,
            self.cost + other.cost,
            self.count + other.count,
            self.left_out + other.left_out,
        )
