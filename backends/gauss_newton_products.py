"""Sums of residuals and Jacobians over rollouts, for Gauss-Newton methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


_ROUNDED = 1e-9
"""Maximum relative difference between two sums of the same row factors."""


@dataclass(frozen=True, slots=True)
class StartBlocks:
    """The parts of the products of one loss that belong to estimated initial states, separately for
    each run. J is the Jacobian of the residuals r in the learned parameters, K that in the run's
    own initial state.
    """

    cross: FloatArray
    """JᵀK of each run, K the Jacobian in its initial state: (runs, learned, elements of a
    start)."""
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
        """The blocks of the loss times `share`, after a change of variables of the learned
        parameters. `learned` are the derivatives of the old variables with respect to the new ones,
        one per parameter element.
        """
        # only the learned parameters change variables, not the initial states
        cross = share * self.cross * learned[None, :, None]
        return StartBlocks(cross, share * self.curvature, share * self.slope)


@dataclass(frozen=True, slots=True)
class Products:
    """Products of the residuals r of one loss and their Jacobian J with respect to the learned
    parameters, summed over rollouts.
    """

    curvature: FloatArray
    """JᵀJ."""
    slope: FloatArray
    """Jᵀr."""
    squares: float
    """rᵀr; equals the cost, except for huber."""
    cost: float
    """Σ of the loss over its elements."""
    count: float
    """Number of scored elements, weighted by the factors of their rows."""
    left_out: float = 0.0
    """Number of scored elements that the products exclude, as their derivatives are infinite."""
    starts: StartBlocks | None = None
    """Blocks of estimated initial states, if any."""

    @property
    def is_left_out(self) -> bool:
        """True if all scored elements are excluded from the products, within rounding of the sums
        of row factors.
        """
        return self.left_out >= (1.0 - _ROUNDED) * self.count

    def __add__(self, other: Products) -> Products:
        # initial states of different runs are different unknowns: `joined_runs` combines them
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


@dataclass(frozen=True, slots=True)
class ProductsOfRuns:
    """The products of one loss if each run has unknowns of its own, such as its initial state,
    besides the shared parameters.
    """

    all: Products
    """The products of the shared parameters, summed over the runs, with the blocks of each run."""
    squares: FloatArray
    """rᵀr of each run."""
    cost: FloatArray
    """Σ of the loss over the elements of each run."""
    count: FloatArray
    """Scored elements of each run."""

    @property
    def blocks(self) -> StartBlocks:
        """The parts that belong to the own unknowns of each run."""
        assert self.all.starts is not None, "each run has numbers"
        return self.all.starts

    def in_order(self, order: NDArray[np.int64]) -> ProductsOfRuns:
        """The same products with the runs in another order: run k is the run `order[k]`."""
        one = self.blocks
        blocks = StartBlocks(one.cross[order], one.curvature[order], one.slope[order])
        every = (self.squares[order], self.cost[order], self.count[order])
        return ProductsOfRuns(replace(self.all, starts=blocks), *every)


def joined_runs(runs: Sequence[Products], own: int) -> ProductsOfRuns:
    """Combines the products of single runs, whose last `own` parameters are unknowns of each run
    itself; all others are shared and summed.
    """
    n = len(runs[0].slope) - own
    blocks = StartBlocks(
        np.array([one.curvature[:n, n:] for one in runs]),
        np.array([one.curvature[n:, n:] for one in runs]),
        np.array([one.slope[n:] for one in runs]),
    )
    shared = [replace(one, curvature=one.curvature[:n, :n], slope=one.slope[:n]) for one in runs]
    return ProductsOfRuns(
        all=replace(sum(shared[1:], shared[0]), starts=blocks),
        squares=np.array([one.squares for one in runs]),
        cost=np.array([one.cost for one in runs]),
        count=np.array([one.count for one in runs]),
    )


def one_after_the_other(parts: Sequence[ProductsOfRuns]) -> ProductsOfRuns:
    """The products of all runs of all parts, with the shared ones summed."""
    shared = [replace(part.all, starts=None) for part in parts]
    blocks = [part.blocks for part in parts]
    starts = StartBlocks(
        np.concatenate([one.cross for one in blocks]),
        np.concatenate([one.curvature for one in blocks]),
        np.concatenate([one.slope for one in blocks]),
    )
    return ProductsOfRuns(
        all=replace(sum(shared[1:], shared[0]), starts=starts),
        squares=np.concatenate([part.squares for part in parts]),
        cost=np.concatenate([part.cost for part in parts]),
        count=np.concatenate([part.count for part in parts]),
    )
