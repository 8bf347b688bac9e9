"""Judges the products of the losses that count: whether a step can be made of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from backends.gauss_newton_products import Products
from msnn.training.engines.learned_numbers import LearnedNumbers
from msnn.training.plans.stage_plan import StagePlan


@dataclass(frozen=True, slots=True)
class CountedProducts:
    """The products of losses with a weight and with rows that are scored; penalties have none."""

    by_loss: Mapping[str, Products]

    @property
    def are_finite(self) -> bool:
        """Whether a step can be made of these; rows of losses that do not count may be anything."""
        return all(
            np.isfinite(one.cost)
            and np.isfinite(one.slope).all()
            and np.isfinite(one.curvature).all()
            and (one.starts is None or np.isfinite(one.starts.curvature).all())
            for one in self.by_loss.values()
        )

    @property
    def leave_out_some(self) -> bool:
        """Whether a residual has no share in the model, as its slopes are infinite."""
        return any(one.left_out for one in self.by_loss.values())

    @property
    def leave_out_all(self) -> bool:
        return bool(self.by_loss) and all(one.is_left_out for one in self.by_loss.values())

    @property
    def make_a_model(self) -> bool:
        """Whether a next step follows from these."""
        return self.are_finite and not self.leave_out_all

    def without_slopes(self, numbers: LearnedNumbers) -> tuple[str, ...]:
        """The parameters in which a loss has no finite slope though its value is one."""
        if not all(np.isfinite(one.cost) for one in self.by_loss.values()):
            return ()
        bad = [
            # the diagonal alone: an infinite slope of one number makes whole rows infinite
            ~np.isfinite(one.slope) | ~np.isfinite(np.diagonal(one.curvature))
            for one in self.by_loss.values()
        ]
        return tuple(p.name for p, part in numbers.parts(np.any(bad, axis=0)) if part.any())


def counted_products(plan: StagePlan, products: Mapping[str, Products]) -> CountedProducts:
    """The products of the losses that count."""
    return CountedProducts(
        {
            loss.name: products[loss.name]
            for loss in plan.rollout.program.losses
            if plan.loss_weights[loss.name] and loss.penalty is None and products[loss.name].count
        }
    )
