"""Residuals, slopes and costs by training kernels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from backends.gauss_newton_products import Products
from backends.native.kernel import Kernel, flat
from backends.native.kernel_data import Data
from backends.native.sensitivity_kernel import SensitivityKernel
from compiler.differentiation.sensitivities import sensitivities
from compiler.differentiation.sums_of_squares import is_sum_of_squares, with_compared_squares
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.starts import Runs
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import LossSums
from msnn.training.engines.native.kernel_check import WrongKernelError, check_kernel
from msnn.training.plans.stage_plan import StagePlan

_MEMBERS = 8
_TOLERANCE = 1e-8
"""Of slopes forward and in reverse, relative to the largest: far above rounding in float64."""

_ROUNDING = 1e-10
"""Of the addends of a slope."""

Weights = Mapping[str, FloatArray]


class NativeSquares:
    """Asks one kernel for slopes and one for costs. Raises CompilerMissingError."""

    def __init__(
        self,
        plan: StagePlan,
        series: Weights,
        train_rows: Mapping[str, BoolArray] | None,
        evaluation_rows: Mapping[str, BoolArray] | None,
    ) -> None:
        program = with_compared_squares(plan.rollout.program)
        self._plan, self._series, self._program = plan, series, program
        self._costs = Kernel(program, "float64", plan.threads)
        self._slopes = SensitivityKernel(sensitivities(program, plan.trained))
        skip = plan.rollout.skip
        self._train = self._slopes.data(series, skip, train_rows)
        self._train_costs = self._costs.data(series, skip, train_rows)
        self._evaluation = self._costs.data(series, skip, evaluation_rows)

    def products(self, runs: Runs, weights: Weights) -> dict[str, Products]:
        """Of every loss: products of its residuals and slopes. Raises WrongKernelError."""
        if not self._slopes.built.is_checked:
            self._check(runs, weights)
            self._slopes.built.mark_checked()
        physical = flat(self._program, weights)
        return self._slopes.products(self._train, runs.t0, runs.steps, physical)

    def train_costs(self, runs: Runs, weights: Weights) -> LossSums:
        """The losses of rollouts to train on."""
        return self._costs_on(self._train_costs, runs, weights)

    def watched_costs(self, runs: Runs, weights: Weights) -> LossSums:
        """The losses of rollouts on the rows that are watched."""
        return self._costs_on(self._evaluation, runs, weights)

    def _costs_on(self, data: Data, runs: Runs, weights: Weights) -> LossSums:
        kernel = self._costs
        groups = kernel.groups(runs.t0, runs.steps)
        physical = flat(self._program, weights)
        every = [1.0] * len(kernel.source.losses)
        found = kernel.losses(data, groups, physical, every, gradient=False)
        named = zip(kernel.source.losses, found.sums.tolist(), found.counts.tolist(), strict=True)
        return {name: LossSum(total, int(count)) for name, total, count in named}

    def _check(self, runs: Runs, weights: Weights) -> None:
        """Costs and reverse slopes against the interpreter, slopes forward against those."""
        skip = self._plan.rollout.skip
        if not self._costs.built.is_checked:
            check_kernel(self._costs, self._series, skip, runs, weights)
            self._costs.built.mark_checked()
        few = runs.take(np.arange(min(_MEMBERS, len(runs))))
        physical = flat(self._program, weights)
        kernel, groups = self._costs, self._costs.groups(few.t0, few.steps)
        squares = {
            loss.name: is_sum_of_squares(self._program.step, loss) for loss in self._program.losses
        }
        counted = [float(squares[name]) for name in kernel.source.losses]
        reverse = kernel.losses(self._train_costs, groups, physical, counted).gradient
        places = self._learned_numbers()
        expected = reverse[places]
        products = self._slopes.products(self._train, few.t0, few.steps, physical)
        found = sum(
            (2.0 * one.slope / one.count for one in products.values() if one.count),
            np.zeros(len(places)),
        )
        largest = float(np.abs(expected).max(initial=0.0))
        if not np.isfinite(largest):
            return
        # at a minimum the sum is far smaller than its addends: Σ |Jr| ≤ √(Σ J² · Σ r²)
        addends = sum(
            (
                np.sqrt(np.diagonal(one.curvature) * one.squares) / one.count
                for one in products.values()
                if one.count
            ),
            np.zeros(len(places)),
        )
        if (np.abs(found - expected) > _TOLERANCE * largest + _ROUNDING * addends).any():
            message = "a kernel of sensitivities computes other slopes than reverse mode"
            raise WrongKernelError(message)

    def _learned_numbers(self) -> list[int]:
        """Where the numbers of the learned parameters stand among all, in the order of slopes."""
        first: dict[str, range] = {}
        total = 0
        for parameter in self._program.parameters:
            size = int(np.prod([axis.size for axis in parameter.axes]))
            first[parameter.name] = range(total, total + size)
            total += size
        return [place for name in self._plan.trained for place in first[name]]
