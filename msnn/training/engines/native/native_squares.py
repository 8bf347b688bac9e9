"""Computes residuals, Jacobians and costs with kernels."""

from __future__ import annotations

from collections.abc import Mapping

from backends.gauss_newton_products import Products, ProductsOfRuns
from backends.native.kernel import Kernel
from backends.native.kernel_data import KernelData
from backends.native.variables import flat
from compiler.differentiation.sums_of_squares import with_compared_squares
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.starts import Runs
from msnn.simulation.engines.kernel_check import check_kernel
from msnn.simulation.engines.kernel_trials import check_if_fresh
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import LossSums
from msnn.training.engines.native.native_slopes import NativeSlopes
from msnn.training.engines.own_series import own_series
from msnn.training.plans.stage_plan import StagePlan

Weights = Mapping[str, FloatArray]


class NativeSquares:
    """Uses one kernel for Jacobians and one for costs. Raises CompilerMissingError."""

    def __init__(
        self,
        plan: StagePlan,
        series: Weights,
        train_rows: Mapping[str, BoolArray] | None,
        evaluation_rows: Mapping[str, BoolArray] | None,
    ) -> None:
        self._slopes = NativeSlopes(plan, series, train_rows)
        self._ranks = plan.ranks
        self._program = with_compared_squares(plan.rollout.program)
        self._series = series = own_series(plan, series)
        self._costs = Kernel(self._program, "float64", plan.threads, slopes=False)
        # arrays of its own again: `write` fills the starts of trained and of watched runs apart
        self._train = self._costs.data(own_series(plan, series), plan.train_skip, train_rows)
        self._evaluation = self._costs.data(series, plan.rollout.skip, evaluation_rows)

    def check(self, runs: Runs, weights: Weights) -> None:
        """Compares newly built kernels with the reference interpreter. Raises WrongKernelError."""
        costs, series = self._costs, self._series
        check_if_fresh(costs.built, lambda: check_kernel(costs, series, runs, weights))
        self._slopes.check(runs, weights)

    def write(self, series: Weights, *, watched: bool) -> None:
        """Replaces the series with the start values of runs, either of watched or of training
        runs.
        """
        self._slopes.write(series, watched=watched)
        (self._evaluation if watched else self._train).write(series)

    def products(self, runs: Runs, weights: Weights) -> dict[str, Products]:
        """JᵀJ and Jᵀr of every loss, with residuals r and Jacobian J."""
        return self._slopes.products(runs, weights)

    def products_of_runs(self, runs: Runs, weights: Weights, own: int) -> dict[str, ProductsOfRuns]:
        """The same products, with separate blocks for the last `own` variables of every run."""
        return self._slopes.products_of_runs(runs, weights, own)

    def train_costs(self, runs: Runs, weights: Weights) -> LossSums:
        """The losses of training rollouts."""
        return self._costs_on(self._train, runs, weights)

    def watched_costs(self, runs: Runs, weights: Weights) -> LossSums:
        """The losses of rollouts on the watched rows."""
        return self._costs_on(self._evaluation, runs, weights)

    def _costs_on(self, data: KernelData, runs: Runs, weights: Weights) -> LossSums:
        kernel = self._costs
        groups = kernel.groups(runs.t0, runs.steps)
        physical = flat(self._program, weights)
        every = [1.0] * len(kernel.source.losses)
        ranks = self._ranks
        found = kernel.losses(data, groups, physical, every, gradient=False, ranks=ranks)
        named = zip(kernel.source.losses, found.sums.tolist(), found.counts.tolist(), strict=True)
        return {name: LossSum(total, count) for name, total, count in named}
