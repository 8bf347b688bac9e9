"""Checks the products of the weighted losses: can they define a step?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from backends.gauss_newton_products import Products
from msnn.training.engines.learned_numbers import LearnedNumbers
from msnn.training.plans.stage_plan import StagePlan


@dataclass(frozen=True, slots=True)
class CountedProducts:
    """The products of losses with a weight and with scored rows, without penalties."""

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
        """True if a residual is excluded from the model because its derivatives are infinite."""
        return any(one.left_out for one in self.by_loss.values())

    @property
    def leave_out_all(self) -> bool:
        return bool(self.by_loss) and all(one.is_left_out for one in self.by_loss.values())

    @property
    def make_a_model(self) -> bool:
        """True if the products determine a next step."""
        return self.are_finite and not self.leave_out_all

    def without_slopes(self, numbers: LearnedNumbers) -> tuple[str, ...]:
        """The parameters with a non-finite derivative of a finite loss."""
        if not all(np.isfinite(one.cost) for one in self.by_loss.values()):
            return ()
        bad = [
            # the diagonal alone: an infinite slope of one number makes whole rows infinite
            ~np.isfinite(one.slope) | ~np.isfinite(np.diagonal(one.curvature))
            for one in self.by_loss.values()
        ]
        return tuple(p.name for p, part in numbers.parts(np.any(bad, axis=0)) if part.any())


def counted_products(plan: StagePlan, products: Mapping[str, Products]) -> CountedProducts:
    """The products of the weighted losses with scored rows."""
    return CountedProducts(
        {
            loss.name: products[loss.name]
            for loss in plan.rollout.program.losses
            if plan.loss_weights[loss.name] and loss.penalty is None and products[loss.name].count
        }
    )
