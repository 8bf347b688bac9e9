"""Computes the Fisher information about parameters, and inverts it where they are identifiable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from backends.gauss_newton_products import Products
from compiler.ir.program import Measure
from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.training.plans.loss_terms import BREAD_OF, MEAT_OF, NUMBER_OF, WITHIN
from msnn.training.plans.stage_plan import StagePlan


class Information(Protocol):
    """The information of residuals about the learned parameters, from which standard errors follow.

    Near the minimum, a change dθ solves M dθ = −s, where noise of the residuals makes the gradient
    s vary.
    """

    @property
    def robust(self) -> Mapping[str, Sandwich]:
        """The sandwich of each robust loss, whose curvature is not JᵀJ of its residuals."""
        ...

    @property
    def used_up(self) -> Mapping[str, float]:
        """The degrees of freedom of each loss that estimated initial states use up."""
        ...

    def of(self, free: IntArray) -> Information:
        """The information about only the elements with the indices `free`; the others are fixed."""
        ...

    def curvature(self) -> FloatArray:
        """The Gauss-Newton curvature, (elements, elements), if initial states follow the
        parameters.

        It is singular if some parameters are not identifiable.
        """
        ...

    def equations(self) -> FloatArray | None:
        """M if it differs from the curvature, because initial states minimise another function."""
        ...

    def spreads(self) -> Mapping[str, FloatArray]:
        """The covariance of s from every loss, for residuals of variance 1."""
        ...

    def variances(self, inverse: FloatArray, measured: frozenset[str]) -> dict[str, float]:
        """The noise variance σ² of each loss in `measured`; `inverse` is M⁻¹."""
        ...


def numbers(products: Mapping[str, Products], name: str) -> float:
    """Number of residuals of a loss that contribute to its products."""
    one = products[name]
    counted = products.get(f"{NUMBER_OF}{name}")
    number = one.count if counted is None else counted.cost
    return number * (1.0 - one.left_out / one.count)


def shares_of(plan: StagePlan, products: Mapping[str, Products]) -> dict[str, float]:
    """cₗ of each loss with scored rows: how much one squared residual contributes to the total."""
    names = [name for name in plan.loss_weights if name in products and products[name].count]
    return {name: _share(plan, name, products[name]) for name in names}


@dataclass(frozen=True, slots=True, kw_only=True)
class Sandwich:
    """Curvature and gradient covariance of a robust loss.

    They are c/2 Σ w ψ' jjᵀ and (c/2)² Σ w² ψ² jjᵀ. Here ψ is the derivative of the cost, and c the
    share of an element in the total. Both refer to half of the total, as for sums of squares, and
    the second to clipped residuals of variance 1. The noise may be heteroscedastic (White 1980).
    """

    bread: FloatArray
    meat: FloatArray
    squares: float
    """Σ w ψ²."""
    within: float
    """Number of unclipped elements; clipped ones have no curvature."""

    @classmethod
    def of_loss(cls, name: str, share: float, products: Mapping[str, Products]) -> Sandwich:
        """Builds both matrices of the loss `name` from the losses that `squared` has added
        for it.
        """
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
        """The matrices for only the elements with the indices `free`."""
        some = np.ix_(free, free)
        return replace(self, bread=self.bread[some], meat=self.meat[some])


@dataclass(frozen=True, slots=True, kw_only=True)
class SymmetricInformation:
    """The information if initial states are known or estimated together with the parameters."""

    products: Mapping[str, Products]
    curvatures: Mapping[str, FloatArray]
    """cₗ JₗᵀJₗ of every loss with scored rows."""
    shares: Mapping[str, float]
    """cₗ."""
    used_up: Mapping[str, float]
    """Degrees of freedom used for initial states."""
    robust: Mapping[str, Sandwich]
    """The sandwich of each robust loss."""

    def of(self, free: IntArray) -> Information:
        """The information about a subset of the elements."""
        some = {name: one[np.ix_(free, free)] for name, one in self.curvatures.items()}
        robust = {name: one.of(free) for name, one in self.robust.items()}
        return replace(self, curvatures=some, robust=robust)

    def curvature(self) -> FloatArray:
        """Σ cₗ JₗᵀJₗ over the losses: the Gauss-Newton curvature of the total, (elements,
        elements).
        """
        return np.asarray(sum(self.curvatures.values()))

    def equations(self) -> FloatArray | None:
        """Half the Hessian of the total, without clipped residuals; None without robust losses."""
        if not self.robust:
            return None
        return np.asarray(sum(map(self._curving, self.curvatures)))

    def spreads(self) -> Mapping[str, FloatArray]:
        """The covariance of the gradient by each loss: cₗ² JₗᵀJₗ; `Sandwich.meat` for robust
        losses.
        """
        return {
            name: self.robust[name].meat if name in self.robust else self.shares[name] * one
            for name, one in self.curvatures.items()
        }

    def variances(self, inverse: FloatArray, measured: frozenset[str]) -> dict[str, float]:
        """rₗᵀrₗ / (nₗ − pₗ); for robust losses, of clipped residuals."""
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
    """The contribution of a squared residual to the total; for RMSE linearised at the minimum."""
    # of the stage's own program: in that of its squares a root is one of them
    loss = next(loss for loss in plan.program.losses if loss.name == name)
    share = plan.loss_weights[loss.name] / found.count
    if loss.measure is Measure.RMSE and found.cost > 0:
        # d√(S/n)/dS = 1 / (2 n √(S/n))
        return share / (2.0 * float(np.sqrt(found.cost / found.count)))
    return share


_NOTHING = 1e-10
"""Curvature, relative to that of single parameters, below which a direction is unidentifiable."""

_SHARE = 1e-3
"""Minimum component with which an element is named as part of an unidentifiable direction."""


def inverted(
    curvature: FloatArray, equations: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """The pseudo-inverse of a symmetric curvature (n, n), and a basis of its null space as columns
    (n, k).

    The null space has the changes of parameters that the data do not determine. Variables are first
    scaled to curvature 1, so that the rank does not depend on units. If `equations` (n, n) are
    given, they are inverted instead on the subspace that the curvature identifies. Raises
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
    """The mask of elements that take part in a direction of the null space `nothing` (n, k)."""
    return np.asarray((nothing * nothing).sum(axis=1) > _SHARE * _SHARE)


def combinations(
    curvature: FloatArray, nothing: FloatArray, names: list[str]
) -> tuple[Mapping[str, float], ...]:
    """The directions of the null space as changes of elements by name, in the parameters' units.

    The largest change is 1; small ones are omitted.
    """
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
