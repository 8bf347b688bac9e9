"""Computes the information about the parameters if each run's first rows determine its start.

Initial states x minimise Σ c̃ₗ r̃ₗᵀr̃ₗ over the first steps of their run, with Jacobians J̃ in the
parameters and K̃ in x. The parameters θ minimise Σ cₗ rₗᵀrₗ of the later steps, with Jacobians J
and K, for given x. At both minima, with A = Σ c̃ₗ K̃ₗᵀK̃ₗ and L = Σ c̃ₗ J̃ₗᵀK̃ₗ A⁻¹ of a run,

    dx = −A⁻¹ Σ c̃ₗ K̃ₗᵀẽₗ − Lᵀ dθ. The residuals follow θ by Dₗ = Jₗ − Kₗ Lᵀ.

    M dθ = −Σ cₗ Jₗᵀeₗ + Σ_runs G Σ c̃ₗ K̃ₗᵀẽₗ, M = Σ cₗ JₗᵀDₗ, G = Σ cₗ JₗᵀKₗ A⁻¹.

The noise ẽ of the first steps thus affects θ through the initial states (two-step estimators:
Newey, McFadden, Handbook of Econometrics IV, 1994, section 6). It is also in the later residuals r,
like a forecast error, so σ² is not rᵀr / (n − p).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from backends.gauss_newton_products import Products, ProductsOfRuns, StartBlocks
from msnn.data.dataset import FloatArray, IntArray
from msnn.training.engines.second_order.squares import inverted_blocks
from msnn.training.records.learned.information import Information, Sandwich, numbers

_ROUNDS = 50
"""Iterations for the variances of several losses; one loss needs one iteration."""


@dataclass(frozen=True, kw_only=True)
class HeldStarts:
    """The information of residuals if initial states are estimated separately from the
    parameters.
    """

    products: Mapping[str, Products]
    """Products of the scored steps, with separate blocks for initial states."""
    shares: Mapping[str, float]
    """cₗ of every loss with scored rows."""
    inverse: FloatArray
    """A⁻¹ of each run, (runs, elements of x, elements of x)."""
    follows: FloatArray
    """L of each run, (runs, learned elements, elements of x)."""
    spread: Mapping[str, FloatArray]
    """c̃ₗ² K̃ₗᵀK̃ₗ of each run."""
    slopes: Mapping[str, FloatArray] | None = None
    """Covariances of the gradient if runs overlap; None if runs share no noise."""

    @classmethod
    def of_blocks(
        cls,
        products: Mapping[str, Products],
        shares: Mapping[str, float],
        first: Mapping[str, StartBlocks],
        decided: Mapping[str, FloatArray],
    ) -> HeldStarts:
        """Builds the information from products of scored steps, blocks of first steps, and their
        c̃.
        """
        factors = {name: decided[name][:, None, None] for name in shares}
        both = sum(factors[name] * first[name].curvature for name in shares)
        mixed = sum(factors[name] * first[name].cross for name in shares)
        inverse = inverted_blocks(np.asarray(both))
        return cls(
            products=products,
            shares=shares,
            inverse=inverse,
            follows=np.asarray(mixed) @ inverse,
            spread={name: factors[name] ** 2 * first[name].curvature for name in shares},
        )

    @classmethod
    def of_runs(
        cls,
        products: Mapping[str, Products],
        shares: Mapping[str, float],
        first: Mapping[str, ProductsOfRuns],
        weights: Mapping[str, float],
    ) -> HeldStarts:
        """Builds the information from products of scored steps and of the first steps of each
        run.
        """
        decided = {name: weights[name] / np.maximum(first[name].count, 1.0) for name in shares}
        blocks = {name: first[name].blocks for name in shares}
        return cls.of_blocks(products, shares, blocks, decided)

    @property
    def robust(self) -> Mapping[str, Sandwich]:
        """Empty: a robust loss has no standard errors if initial states are estimated
        separately.
        """
        return {}

    @property
    def used_up(self) -> Mapping[str, float]:
        """Empty: the variances account for the degrees of freedom of the initial states."""
        return {}

    def of(self, free: IntArray) -> Information:
        """The same information about only the elements with the indices `free`; the others are
        fixed.
        """
        some: dict[str, Products] = {}
        for name, one in self.products.items():
            blocks = _blocks(one)
            starts = replace(blocks, cross=blocks.cross[:, free])
            some[name] = replace(one, curvature=one.curvature[np.ix_(free, free)], starts=starts)
        slopes = self.slopes
        if slopes is not None:
            slopes = {name: one[np.ix_(free, free)] for name, one in slopes.items()}
        return replace(self, products=some, follows=self.follows[:, free], slopes=slopes)

    def curvature(self) -> FloatArray:
        """Σ cₗ DₗᵀDₗ (see the module): the Gauss-Newton curvature if initial states follow the
        parameters.
        """
        return np.asarray(sum(c * self._moving(name) for name, c in self.shares.items()))

    def equations(self) -> FloatArray | None:
        """M = Σ cₗ JₗᵀDₗ (see the module), which maps a change of the parameters to the
        gradient.
        """
        return np.asarray(sum(c * self._crossing(name) for name, c in self.shares.items()))

    def spreads(self) -> Mapping[str, FloatArray]:
        """The covariance of the gradient by the noise of each loss, for noise of variance 1.

        cₗ² JₗᵀJₗ + Σ G c̃ₗ² K̃ₗᵀK̃ₗ Gᵀ over runs that do not overlap.
        """
        if self.slopes is not None:
            return self.slopes
        return {
            name: c**2 * self.products[name].curvature
            + np.einsum("rpn,rnm,rqm->pq", self.carried, self.spread[name], self.carried)
            for name, c in self.shares.items()
        }

    def variances(self, inverse: FloatArray, measured: frozenset[str]) -> dict[str, float]:
        """σₗ² that explain the squares of every loss: squaresₗ = Σ over m of F[l, m] σₘ²."""
        names = [name for name in self.shares if name in measured]
        squares = np.array([self.products[name].squares for name in names])
        factors = np.array([[self._factor(a, b, inverse) for b in names] for a in names])
        found = squares / np.array([numbers(self.products, name) for name in names])
        # a fixed point has F σ² = squares; factors above 0 keep variances above 0
        for _ in range(_ROUNDS if len(names) > 1 else 1):
            found = found * squares / np.maximum(factors @ found, np.finfo(np.float64).tiny)
        # the squares of a loss that its own noise does not reach say nothing of its variance
        decided = np.diagonal(factors) > 0
        return {n: float(v) if d else np.nan for n, v, d in zip(names, found, decided, strict=True)}

    def _factor(self, name: str, noise: str, inverse: FloatArray) -> float:
        """F: expected squares of one loss for noise of variance 1 in another loss."""
        starts, spread = _blocks(self.products[name]), self.spread[noise]
        moved = inverse @ self.spreads()[noise] @ inverse.T
        forecast = self.inverse @ spread @ self.inverse
        both = (starts.cross - self.follows @ starts.curvature) @ self.inverse @ spread
        # a residual varies by the numbers, by its start, and by what both have of the same noise
        found = float(np.sum(self._moving(name) * moved))
        found += float(np.sum(starts.curvature * forecast))
        found -= 2.0 * float(np.einsum("rpn,rqn,qp->", both, self.carried, inverse.T))
        if name == noise:
            # its own noise, less what the numbers take of it
            own = np.sum(inverse.T * self._crossing(name))
            found += numbers(self.products, name) - 2.0 * self.shares[name] * float(own)
        return found

    @cached_property
    def carried(self) -> FloatArray:
        """G of each run, (runs, elements, elements of x): how initial states change the gradient
        (see the module).
        """
        cross = sum(c * _blocks(self.products[name]).cross for name, c in self.shares.items())
        return np.asarray(cross) @ self.inverse

    def _crossing(self, name: str) -> FloatArray:
        """JᵀD of one loss, (elements, elements); J and D are explained in the module."""
        one = self.products[name]
        return one.curvature - np.einsum("rpn,rqn->pq", _blocks(one).cross, self.follows)

    def _moving(self, name: str) -> FloatArray:
        """DᵀD of one loss, (elements, elements); D is explained in the module."""
        crossing, own = self._crossing(name), _blocks(self.products[name]).curvature
        # JᵀK Lᵀ, so that DᵀD = JᵀD − (JᵀK Lᵀ)ᵀ + L KᵀK Lᵀ
        mixed = self.products[name].curvature - crossing
        return crossing - mixed.T + np.einsum("rpn,rnm,rqm->pq", self.follows, own, self.follows)


def _blocks(one: Products) -> StartBlocks:
    assert one.starts is not None, "starts are apart"
    return one.starts
