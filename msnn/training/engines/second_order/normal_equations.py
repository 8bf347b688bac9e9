"""The total loss near the current variables, and the step that lowers it for a given damping."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from backends.gauss_newton_products import Products, StartBlocks
from backends.known_terms import KnownTerms, approached
from msnn.data.dataset import FloatArray
from msnn.training.engines.second_order.damped_steps import (
    UNDAMPED,
    DampedModel,
    QuadraticTerms,
    VariableBounds,
)
from msnn.training.engines.second_order.squares import LearnedNumbers
from msnn.training.plans.stage_plan import StagePlan

STATIONARY = 1e-4
"""Cosine between residuals and a column of the Jacobian below which a variable is stationary."""

NO_INFLUENCE = 1e-300
"""Curvature up to which quotients may overflow; such a variable has no influence."""


class QuadraticModel(Protocol):
    """The quadratic model of the total loss F near the current variables; it gives a step for a
    damping.
    """

    @property
    def total(self) -> float:
        """F at the current variables."""
        ...

    def step(self, damping: float) -> tuple[FloatArray, float]:
        """The step in raw variables for this damping, and the predicted decrease of the total."""
        ...

    def promise(self) -> float:
        """The decrease of F that the model predicts for a step with almost no damping, within the
        bounds.
        """
        ...


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """The total loss F of a stage at given raw variables, with half its derivatives: g and A.

    The gradient of F is 2g, its Gauss-Newton Hessian 2A. Raw variables are parameters divided by
    their scale, or the physical values of bounded parameters.
    """

    total: float
    """F."""
    slope: FloatArray
    """g in the parameters."""
    curvature: FloatArray
    """A in the parameters."""
    starts: StartBlocks | None
    """The blocks of g and A for the initial states of each run; None if they are not variables."""

    @property
    def diagonal(self) -> FloatArray:
        """The diagonal of A: the parameters, then the initial states of all runs."""
        of_parameters = np.diagonal(self.curvature)
        if self.starts is None:
            return of_parameters
        own = np.diagonal(self.starts.curvature, axis1=1, axis2=2)
        return np.concatenate([of_parameters, own.ravel()])

    def plus(self, known: QuadraticTerms, penalties: float) -> NormalEquations:
        """The sum of this and of the terms of the parameters: weight decay, priors and
        penalties.
        """
        return replace(
            self,
            total=self.total + known.value + penalties,
            slope=self.slope + known.slope,
            curvature=self.curvature + np.diag(known.curvature),
        )

    def is_stationary(self, raw: FloatArray, known: KnownTerms, bounds: VariableBounds) -> bool:
        """True if no single variable, moved within its bounds, changes the residuals noticeably.

        For a variable inside its bounds the condition is |Jᵢᵀr| <= limit · |Jᵢ| |r|, the unit-free
        measure of MINPACK's `gtol` (Moré 1978). On a bound it is the condition of Karush, Kuhn and
        Tucker: the derivative may have the sign that points outward.
        """
        slope, diagonal = self.whole_slope, self.diagonal
        curved = np.where(diagonal > NO_INFLUENCE, diagonal, np.inf)
        move, n = -slope / curved, len(raw)
        reached = approached(known, raw + move[:n], 0.5 / curved[:n], 0.0)
        move[:n] = np.clip(reached, bounds.low, bounds.high) - raw
        return bool(np.all(move * move * diagonal <= STATIONARY**2 * self.total))

    def onto_bounds(self, raw: FloatArray, bounds: VariableBounds) -> FloatArray:
        """The variables, moved to a bound if the minimum along the single variable is at or beyond
        it.
        """
        diagonal = np.diagonal(self.curvature)
        reached = raw - self.slope / np.where(diagonal > NO_INFLUENCE, diagonal, np.inf)
        below = np.where(reached <= bounds.low, bounds.low, raw)
        return np.where(reached >= bounds.high, bounds.high, below)

    @property
    def whole_slope(self) -> FloatArray:
        """Half the gradient of F: in the parameters, then in the initial states of all runs."""
        if self.starts is None:
            return self.slope
        return np.concatenate([self.slope, self.starts.slope.ravel()])

    def model(
        self, scale: FloatArray, raw: FloatArray, known: KnownTerms, bounds: VariableBounds
    ) -> QuadraticModel:
        """The quadratic model at the variables `raw`, from which steps are computed.

        Its variables are those divided by `scale`; penalties and priors are in `known`.
        """
        n = len(self.curvature)
        # scale first: with units such as N/m and mm, small eigenvalues would be lost in rounding
        top = scale[:n]
        values, vectors = np.linalg.eigh(_scaled(self.curvature, top))
        parameters = DampedModel(
            total=self.total,
            raw=raw,
            scale=top,
            slope=self.slope * top,
            # JᵀJ has no eigenvalue below 0 but by rounding
            curvatures=np.maximum(values, 0.0),
            directions=vectors,
            known=known,
            box=bounds.box(raw, top, self.slope * top),
        )
        if self.starts is None:
            return parameters
        return ArrowModel.of(parameters, self.curvature, self.starts, scale[n:])


def in_raw_variables(
    products: Mapping[str, Products], shares: Mapping[str, float], physical_by_raw: FloatArray
) -> NormalEquations:
    """The normal equations of the total: the products of each loss times its share of the total.

    `products` are derivatives in physical values; `physical_by_raw`, (elements,), converts them to
    raw variables.
    """
    n = len(physical_by_raw)
    total, slope, curvature = 0.0, np.zeros(n), np.zeros((n, n))
    blocks: list[StartBlocks] = []
    for name, share in shares.items():
        found = products[name]
        total += share * found.cost
        slope += share * found.slope * physical_by_raw
        # ∂r/∂raw = ∂r/∂θ · ∂θ/∂raw on both sides of JᵀJ; second slopes of the bounds are left out,
        # as all second slopes are
        curvature += share * found.curvature * np.outer(physical_by_raw, physical_by_raw)
        if found.starts is not None:
            blocks.append(found.starts.scaled(share, physical_by_raw))
    starts = sum(blocks[1:], blocks[0]) if blocks else None
    return NormalEquations(total, slope, curvature, starts)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArrowModel:
    """The quadratic model F + 2gᵀδ + δᵀAδ + P of the total loss F and penalties P.

    A has one block per run, and a border for the parameters. Eliminating the initial states leaves
    the damped model of the parameters. Its curvature is the Schur complement
    S = A − Σ B(C + μ)⁻¹Bᵀ of the blocks C of the runs (Golub, Pereyra 1973). Initial states have
    no penalties P. All variables are scaled by 1/√D.
    """

    parameters: DampedModel
    """The model of the parameters with fixed initial states."""
    curvature: FloatArray
    """Curvature of the parameters."""
    slope: FloatArray
    """Half the gradient in the initial states, (runs, elements)."""
    scale: FloatArray
    """1/√D of the initial states, (runs, elements)."""
    cross: FloatArray
    values: FloatArray
    """Eigenvalues of the blocks of the runs, all ≥ 0."""
    directions: FloatArray

    @property
    def total(self) -> float:
        """F at the current variables."""
        return self.parameters.total

    def promise(self) -> float:
        """The decrease of F that the model predicts for a step with almost no damping, within the
        bounds.
        """
        return replace(self, parameters=self.parameters.undamped).step(UNDAMPED)[1]

    @classmethod
    def of(
        cls, parameters: DampedModel, curvature: FloatArray, blocks: StartBlocks, scale: FloatArray
    ) -> ArrowModel:
        """Builds the model; `parameters` is already scaled, the others are not.

        `curvature` is that of the parameters, `blocks` those of the initial states of each run,
        `scale` is 1/√D of the initial states.
        """
        top, own = parameters.scale, scale.reshape(blocks.slope.shape)
        values, directions = np.linalg.eigh(blocks.curvature * own[:, :, None] * own[:, None, :])
        return cls(
            parameters=parameters,
            curvature=_scaled(curvature, top),
            slope=blocks.slope * own,
            scale=own,
            cross=blocks.cross * top[None, :, None] * own[:, None, :],
            # the blocks too are JᵀJ
            values=np.maximum(values, 0.0),
            directions=directions,
        )

    def step(self, damping: float) -> tuple[FloatArray, float]:
        """The step in raw variables, then initial states, and the predicted decrease of the
        total.
        """
        # in the directions of each block (C + μ) is diagonal: one decomposition serves every
        # damping
        turned = self.cross @ self.directions
        shares = np.einsum("rni,rn->ri", self.directions, self.slope) / (self.values + damping)
        left = turned / (self.values + damping)[:, None, :]
        # S without the damping of the parameters, which their own step adds
        complement = self.curvature - np.einsum("rpi,rqi->pq", left, turned)
        values, vectors = np.linalg.eigh(complement)
        reduced = replace(
            self.parameters,
            slope=self.parameters.slope - np.einsum("rpi,ri->p", turned, shares),
            curvatures=np.maximum(values, 0.0),
            directions=vectors,
        )
        moved, _ = reduced.step(damping)
        of_parameters = moved / self.parameters.scale
        # the starts follow the parameters that were found
        inside = -shares - np.einsum("rpi,p->ri", left, of_parameters)
        of_starts = np.einsum("rni,ri->rn", self.directions, inside)
        step = np.concatenate([moved, (of_starts * self.scale).ravel()])
        along = 2.0 * float(self.parameters.slope @ of_parameters + np.sum(self.slope * of_starts))
        crossed = 2.0 * float(np.einsum("p,rpn,rn->", of_parameters, self.cross, of_starts))
        # what the undamped model says of the step: damping shortens it and promises nothing
        bent = float(of_parameters @ self.curvature @ of_parameters)
        bent += crossed + float(np.sum(self.values * inside * inside))
        return step, self.parameters.lost_corners(moved) - along - bent


def _scaled(curvature: FloatArray, scale: FloatArray) -> FloatArray:
    """The curvature in scaled variables; multiplied twice, because the product of scales may
    overflow.
    """
    return curvature * scale[:, None] * scale


@dataclass(frozen=True, slots=True)
class CountedProducts:
    """JᵀJ and Jᵀr of each loss that counts: it has a weight and scored rows, and is no penalty."""

    by_loss: Mapping[str, Products]

    @property
    def are_finite(self) -> bool:
        """True if all products are finite."""
        return all(
            np.isfinite(one.cost)
            and np.isfinite(one.slope).all()
            and np.isfinite(one.curvature).all()
            and (one.starts is None or np.isfinite(one.starts.curvature).all())
            for one in self.by_loss.values()
        )

    @property
    def leave_out_some(self) -> bool:
        """True if some residuals were omitted because their derivatives are infinite."""
        return any(one.left_out for one in self.by_loss.values())

    @property
    def leave_out_all(self) -> bool:
        return bool(self.by_loss) and all(one.is_left_out for one in self.by_loss.values())

    @property
    def make_a_model(self) -> bool:
        """True if the products are finite and not all residuals were omitted, so that a step can be
        computed.
        """
        return self.are_finite and not self.leave_out_all

    def without_slopes(self, numbers: LearnedNumbers) -> tuple[str, ...]:
        """Names of the parameters with a non-finite derivative; empty if a loss itself is not
        finite.
        """
        if not all(np.isfinite(one.cost) for one in self.by_loss.values()):
            return ()
        bad = [
            # the diagonal alone: an infinite slope of one number makes whole rows infinite
            ~np.isfinite(one.slope) | ~np.isfinite(np.diagonal(one.curvature))
            for one in self.by_loss.values()
        ]
        return tuple(p.name for p, part in numbers.parts(np.any(bad, axis=0)) if part.any())


def counted_products(plan: StagePlan, products: Mapping[str, Products]) -> CountedProducts:
    """Selects the products of losses that have a weight and scored rows, and are no penalty."""
    return CountedProducts(
        {
            loss.name: products[loss.name]
            for loss in plan.rollout.program.losses
            if plan.loss_weights[loss.name] and loss.penalty is None and products[loss.name].count
        }
    )
