"""Sums over rollouts what Gauss-Newton methods need of a loss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


_ROUNDED = 1e-9
"""Part by which two sums of the factors of the same rows may differ."""


@dataclass(frozen=True, slots=True)
class StartBlocks:
    """The blocks of the starts in the products of one loss: no run knows another's start."""

    cross: FloatArray
    """JᵀK of each run, K the slopes in its start: (runs, learned, numbers of a start)."""
    curvature: FloatArray
    """KᵀK of each run."""
    slope: FloatArray
    """Kᵀr of each run."""

    def __add__(self, other: StartBlocks) -> StartBlocks:
        return StartBlocks(
            self.cross + other.cross,
            self.curvature + other.curvature,
            self.slope + other.slope,
        )

    def scaled(self, share: float, learned: FloatArray) -> StartBlocks:
        """So many times these, of learned numbers with these slopes in other variables."""
        # the learned numbers have other variables; those of a start stay what they are
        cross = share * self.cross * learned[None, :, None]
        return StartBlocks(cross, share * self.curvature, share * self.slope)


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
    starts: StartBlocks | None = None
    """Where starts are unknowns too."""

    @property
    def is_left_out(self) -> bool:
        """Whether everything that is scored is left out; sums of factors of rows are rounded."""
        return self.left_out >= (1.0 - _ROUNDED) * self.count

    def __add__(self, other: Products) -> Products:
        # starts of other runs are other unknowns: whoever has some joins them
        assert self.starts is None
        assert other.starts is None
        return Products(
            curvature=self.curvature + other.curvature,
            slope=self.slope + other.slope,
            squares=self.squares + other.squares,
            cost=self.cost + other.cost,
            count=self.count + other.count,
            left_out=self.left_out + other.left_out,
        )
