"""Holds what residuals say of the learned numbers where their runs start at known values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from backends.gauss_newton_products import Products
from compiler.ir.program import Measure
from msnn.data.dataset import FloatArray, IntArray
from msnn.training.plans.squared_losses import BREAD_OF, MEAT_OF, NUMBER_OF, WITHIN
from msnn.training.plans.stage_plan import StagePlan


class Information(Protocol):
    """The information that decides the learned numbers, near the minimum.

    A change dθ of them solves M dθ = −s, of which the noise of loss l makes the slope s vary.
    """

    @property
    def robust(self) -> Mapping[str, Sandwich]:
        """The sums of losses whose curvature is not that of their squares."""
        ...

    @property
    def used_up(self) -> Mapping[str, float]:
        """Residuals of each loss that starts have paid for."""
        ...

    def of(self, free: IntArray) -> Information:
        """The same of some of the numbers, the others held."""
        ...

    def curvature(self) -> FloatArray:
        """The curvature of the total, starts following: flat where numbers change nothing."""
        ...

    def equations(self) -> FloatArray | None:
        """M where it is not the curvature: starts minimise something else than the total."""
        ...

    def spreads(self) -> Mapping[str, FloatArray]:
        """The covariance of s of every loss, for residuals of variance 1."""
        ...

    def variances(self, inverse: FloatArray, measured: frozenset[str]) -> dict[str, float]:
        """σ² of the residuals of measured losses, with the inverse of M."""
        ...


def numbers(products: Mapping[str, Products], name: str) -> float:
    """Residuals of a loss that have a share in its products."""
    one = products[name]
    counted = products.get(f"{NUMBER_OF}{name}")
    number = one.count if counted is None else counted.cost
    return number * (1.0 - one.left_out / one.count)


def shares_of(plan: StagePlan, products: Mapping[str, Products]) -> dict[str, float]:
    """cₗ of the losses that score something: what a squared residual adds to the total."""
    names = [name for name in plan.loss_weights if name in products and products[name].count]
    return {name: _share(plan, name, products[name]) for name in names}


@dataclass(frozen=True, slots=True, kw_only=True)
class Sandwich:
    """The two sums of a robust loss: its curvature, and the covariance of its gradient.

    With ψ the derivative of the cost and c the share of an element in the total, both of half of
    the total, as those of sums of squares are: c/2 Σ w ψ' jjᵀ, and (c/2)² Σ w² ψ² jjᵀ for clipped
    residuals whose variance is 1. Noise may differ from row to row (White 1980).
    """

    bread: FloatArray
    meat: FloatArray
    squares: float
    """Σ w ψ²."""
    within: float
    """Elements that are not clipped: the others have no curvature."""

    @classmethod
    def of_loss(cls, name: str, share: float, products: Mapping[str, Products]) -> Sandwich:
        """From the products of the losses that stand for it."""
        bread, meat = products[f"{BREAD_OF}{name}"], products[f"{MEAT_OF}{name}"]
        # Σ w ψ² / n is the variance that the gradient is divided by
        variance = bread.squares / numbers(products, name)
        return cls(
            bread=0.5 * share * bread.curvature,
            meat=(0.5 * share) ** 2 * meat.curvature / variance if variance else meat.curvature,
            squares=bread.squares,
            within=products[f"{WITHIN}{name}"].cost,
        )

    def of(self, free: IntArray) -> Sandwich:
        """The same of some of the numbers."""
        some = np.ix_(free, free)
        return replace(self, bread=self.bread[some], meat=self.meat[some])


@dataclass(frozen=True, slots=True, kw_only=True)
class SymmetricInformation:
    """The information of residuals whose starts are known, or were estimated with the numbers."""

    products: Mapping[str, Products]
    curvatures: Mapping[str, FloatArray]
    """cₗ JₗᵀJₗ of every loss that scores something."""
    shares: Mapping[str, float]
    """cₗ."""
    used_up: Mapping[str, float]
    """Residuals that starts have paid for."""
    robust: Mapping[str, Sandwich]
    """Of the losses whose curvature is not that of their squares."""

    def of(self, free: IntArray) -> Information:
        """The same of some of the numbers."""
        some = {name: one[np.ix_(free, free)] for name, one in self.curvatures.items()}
        robust = {name: one.of(free) for name, one in self.robust.items()}
        return replace(self, curvatures=some, robust=robust)

    def curvature(self) -> FloatArray:
        """Σ cₗ JₗᵀJₗ."""
        return np.asarray(sum(self.curvatures.values()))

    def equations(self) -> FloatArray | None:
        """Half the second derivative of the total, where clipped residuals have no part in it."""
        if not self.robust:
            return None
        return np.asarray(sum(map(self._curving, self.curvatures)))

    def spreads(self) -> Mapping[str, FloatArray]:
        """cₗ² JₗᵀJₗ, of robust losses the meat."""
        return {
            name: self.robust[name].meat if name in self.robust else self.shares[name] * one
            for name, one in self.curvatures.items()
        }

    def variances(self, inverse: FloatArray, measured: frozenset[str]) -> dict[str, float]:
        """rₗᵀrₗ / (nₗ − pₗ), of robust losses that of clipped residuals."""
        found: dict[str, float] = {}
        for name in (name for name in self.curvatures if name in measured):
            freedom = numbers(self.products, name) - self.used_up.get(name, 0.0)
            # tr(M⁻¹ cₗJₗᵀJₗ), both symmetric: how many of the learned numbers this loss decides
            freedom -= float(np.sum(inverse * self._curving(name)))
            robust = self.robust.get(name)
            squares = self.products[name].squares if robust is None else robust.squares
            found[name] = squares / freedom if freedom > 0 else np.nan
        return found

    def _curving(self, name: str) -> FloatArray:
        return self.robust[name].bread if name in self.robust else self.curvatures[name]


def _share(plan: StagePlan, name: str, found: Products) -> float:
    """The share of a squared residual in the total; near the minimum for a root."""
    # of the stage's own program: in that of its squares a root is one of them
    loss = next(loss for loss in plan.program.losses if loss.name == name)
    share = plan.loss_weights[loss.name] / found.count
    if loss.measure is Measure.RMSE and found.cost > 0:
        # d√(S/n)/dS = 1 / (2 n √(S/n))
        return share / (2.0 * float(np.sqrt(found.cost / found.count)))
    return share
