"""Computes residuals, Jacobians and costs in torch, with forward-mode differentiation."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from backends.gauss_newton_products import (
    Products,
    ProductsOfRuns,
    StartBlocks,
    one_after_the_other,
)
from backends.torch_module.module import build_module
from compiler.differentiation.sensitivities import scales_of, sensitivities
from compiler.differentiation.sums_of_squares import with_compared_squares
from compiler.ir.program import Loss, Measure
from compiler.ir.slopes import LARGEST_SLOPE
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.rollout_rows import Runs
from msnn.training.engines.engine import LossSums, batches_of, own_series
from msnn.training.engines.torch.torch_losses import (
    TorchScoring,
    cost,
    evaluated,
    scored_values,
    scoring,
)
from msnn.training.plans.stage_plan import StagePlan

_TANGENTS = 20_000
"""Rollouts times learned elements processed in parallel; limits the memory."""

Weights = Mapping[str, FloatArray]


class TorchSquares:
    """Least squares of a stage in torch: it simulates rollouts and their derivatives in forward
    mode.
    """

    def __init__(
        self,
        plan: StagePlan,
        series: Weights,
        train_rows: Mapping[str, BoolArray] | None,
        evaluation_rows: Mapping[str, BoolArray] | None,
    ) -> None:
        program = with_compared_squares(plan.rollout.program)
        self._losses = {loss.name: loss for loss in program.losses}
        self._trained = plan.trained
        self._steep = {
            one.loss.name: one.left_out is not None
            for one in sensitivities(program, plan.trained).residuals
        }
        """True if a residual of the loss can have an infinite derivative, by loss."""
        scales = scales_of(program, plan.trained)
        self._scales = torch.tensor(scales, dtype=torch.float64, device=plan.device)
        self._model = build_module(program, torch.float64, plan.device).requires_grad_(False)
        series, skip = own_series(plan, series), plan.train_skip
        self._train = scoring(self._model, own_series(plan, series), skip, train_rows)
        self._evaluation = scoring(self._model, series, plan.rollout.skip, evaluation_rows)

    def check(self, runs: Runs, weights: Weights) -> None:
        """Does nothing: torch needs no check against the reference interpreter."""

    def write(self, series: Weights, *, watched: bool) -> None:
        """Overwrites the series of initial states (see `Engine.write`)."""
        into = self._evaluation if watched else self._train
        for name, values in series.items():
            into.series[name].copy_(torch.from_numpy(values))

    def products(self, runs: Runs, weights: Weights) -> dict[str, Products]:
        """JᵀJ and Jᵀr of every loss, with residuals r and Jacobian J."""
        sums: dict[str, Products] = {}
        for _, rows in self._rows(runs, weights):
            for name, one in rows.items():
                found = one.products()
                sums[name] = sums[name] + found if name in sums else found
        return sums

    def products_of_runs(self, runs: Runs, weights: Weights, own: int) -> dict[str, ProductsOfRuns]:
        """The same products, separately for each rollout in the last `own` variables, its initial
        states.
        """
        parts: dict[str, list[ProductsOfRuns]] = {}
        for batch, rows in self._rows(runs, weights):
            for name, one in rows.items():
                parts.setdefault(name, []).append(one.products_of_runs(len(batch), own))
        return {name: one_after_the_other(found) for name, found in parts.items()}

    def _rows(self, runs: Runs, weights: Weights) -> Iterator[tuple[Runs, dict[str, _Rows]]]:
        """Yields batches of rollouts with the residuals and Jacobians of every loss."""
        values = self._tensors(weights)
        learned = torch.cat([values[name].reshape(-1) for name in self._trained])
        for batch in batches_of(runs, max(1, _TANGENTS // len(learned))):
            yield batch, self._rows_of(batch, values, learned)

    def _rows_of(
        self, runs: Runs, values: Mapping[str, Tensor], learned: Tensor
    ) -> dict[str, _Rows]:
        others: dict[str, tuple[Tensor | None, Tensor]] = {}

        def errors(numbers: Tensor) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
            # not a product with 0: a number may be infinite
            zero = torch.where(torch.zeros_like(numbers[0], dtype=torch.bool), numbers[0], 0.0)
            with self._model.constants_with_tangents(zero):
                frame = self._model.frame_of({**values, **self._parts(values, numbers)})
                scored = scored_values(self._model, frame, self._train, runs)
            found: dict[str, Tensor] = {}
            for name, one in scored.items():
                if one is None:
                    found[name] = numbers.new_zeros(0)
                    others[name] = (None, torch.zeros(0, dtype=torch.int64))
                else:
                    target = 0.0 if one.target is None else one.target
                    found[name] = (one.prediction - target).reshape(-1)
                    others[name] = (one.factors, one.runs.reshape(-1))
            # jacfwd differentiates the first and hands the second through: one rollout has both
            return found, found

        forward: Any = torch.func.jacfwd(errors, has_aux=True)
        with warnings.catch_warnings():
            # what torch says of its own modules when it first loads its forward mode
            warnings.simplefilter("ignore", FutureWarning)
            slopes, residuals = forward(learned)
        return {
            name: _Rows.of(
                loss,
                residuals[name],
                slopes[name],
                *others[name],
                scales=self._scales if self._steep.get(name, False) else None,
            )
            for name, loss in self._losses.items()
        }

    def _tensors(self, weights: Weights) -> dict[str, Tensor]:
        arrays = {name: np.asarray(value, float) for name, value in weights.items()}
        return {n: torch.from_numpy(array).to(self._model.device) for n, array in arrays.items()}

    def _parts(self, values: Mapping[str, Tensor], numbers: Tensor) -> dict[str, Tensor]:
        sizes = [values[name].numel() for name in self._trained]
        parts = zip(self._trained, torch.split(numbers, sizes), strict=True)
        return {name: part.reshape(values[name].shape) for name, part in parts}

    def train_costs(self, runs: Runs, weights: Weights) -> LossSums:
        """The losses of training rollouts, without derivatives."""
        return self._costs(self._train, runs, weights)

    def watched_costs(self, runs: Runs, weights: Weights) -> LossSums:
        """The losses of rollouts on the rows of the monitor's set, without derivatives."""
        return self._costs(self._evaluation, runs, weights)

    def _costs(self, data: TorchScoring, runs: Runs, weights: Weights) -> LossSums:
        values = self._tensors(weights)
        return evaluated(self._model, data, runs, self._model.frame_of(values))


@dataclass(frozen=True, slots=True)
class _Rows:
    """Residuals (n,) and Jacobian (n, variables) of one loss; rows with infinite
    derivatives are 0.
    """

    error: Tensor
    slopes: Tensor
    costs: Tensor
    """The weighted contribution of each element to the loss."""
    factors: Tensor
    left_out: Tensor
    """The weight of excluded elements, 0 for the others."""
    runs: Tensor

    @classmethod
    def of(
        cls,
        loss: Loss,
        error: Tensor,
        slopes: Tensor,
        factors: Tensor | None,
        runs: Tensor,
        scales: Tensor | None,
    ) -> _Rows:
        """Builds the rows; Huber and row factors become weights of residuals.

        The weight of a Huber residual gives its square the gradient of the Huber cost. With
        `scales`, derivatives may be infinite.
        """
        each = torch.ones_like(error) if factors is None else factors.reshape(-1)
        costs = each * cost(loss, error, None)
        # |e| < δ: f²e² = e²/2; otherwise the derivative 2f²e is δ · sign(e)
        if loss.measure is Measure.HUBER:
            factor = torch.sqrt(0.5 * loss.delta / error.abs().clamp(min=loss.delta))
            error, slopes = factor * error, factor[:, None] * slopes
        if factors is not None:
            error, slopes = each.sqrt() * error, each.sqrt()[:, None] * slopes
        left_out = torch.zeros_like(each)
        if scales is not None:
            finite = (slopes.abs() * scales).sum(1) <= LARGEST_SLOPE  # false for NaN
            left_out = torch.where(finite, left_out, each)
            # where, not a product: 0 · inf is not a number
            error = torch.where(finite, error, 0.0)
            slopes = torch.where(finite[:, None], slopes, 0.0)
        return cls(error, slopes, costs, each, left_out, runs)

    def products(self) -> Products:
        """JᵀJ and Jᵀr over all rows, with the sum of squares, the loss and the counts."""
        return Products(
            curvature=(self.slopes.T @ self.slopes).cpu().numpy(),
            slope=(self.slopes.T @ self.error).cpu().numpy(),
            squares=float(self.error @ self.error),
            cost=self.costs.sum().item(),
            count=self.factors.sum().item(),
            left_out=self.left_out.sum().item(),
        )

    def products_of_runs(self, runs: int, own: int) -> ProductsOfRuns:
        """The same products, separately for each of `runs` rollouts in the last `own` variables."""
        n = self.slopes.shape[1] - own
        shared, apart = self.slopes[:, :n], self.slopes[:, n:]

        def sums(values: Tensor) -> FloatArray:
            found = values.new_zeros((runs, *values.shape[1:]))
            return found.index_add(0, self.runs.to(values.device), values).cpu().numpy()

        blocks = StartBlocks(
            sums(shared[:, :, None] * apart[:, None, :]),
            sums(apart[:, :, None] * apart[:, None, :]),
            sums(apart * self.error[:, None]),
        )
        whole = self.products()
        return ProductsOfRuns(
            all=replace(
                whole,
                curvature=whole.curvature[:n, :n],
                slope=whole.slope[:n],
                starts=blocks,
            ),
            squares=sums(self.error * self.error),
            cost=sums(self.costs),
            count=sums(self.factors),
        )
