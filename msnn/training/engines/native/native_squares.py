"""Computes residuals, slopes and costs by training kernels."""

from __future__ import annotations

from collections.abc import Mapping

from backends.gauss_newton_products import Products
from backends.native.kernel import Kernel
from backends.native.kernel_data import KernelData
from backends.native.sensitivity_kernel import SensitivityKernel
from backends.native.variables import flat
from compiler.differentiation.sensitivities import sensitivities
from compiler.differentiation.sums_of_squares import with_compared_squares
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.starts import Runs
from msnn.simulation.engines.kernel_trials import check_if_fresh
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import LossSums
from msnn.training.engines.native.kernel_check import check_kernel, check_sensitivities
from msnn.training.engines.own_series import own_series
from msnn.training.plans.stage_plan import StagePlan

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
        self._plan, self._program = plan, program
        self._series = series = own_series(plan, series)
        self._costs = Kernel(program, "float64", plan.threads)
        self._sensitivities = sensitivities(program, plan.trained)
        self._slopes = SensitivityKernel(self._sensitivities)
        own, skip = own_series(plan, series), plan.train_skip
        self._train = self._slopes.data(own, skip, train_rows)
        self._train_costs = self._costs.data(own, skip, train_rows)
        self._evaluation = self._costs.data(series, plan.rollout.skip, evaluation_rows)

    def check(self, runs: Runs, weights: Weights) -> None:
        """Compares fresh kernels with the interpreter. Raises WrongKernelError."""
        costs, slopes, series = self._costs, self._slopes, self._series
        check_if_fresh(costs.built, lambda: check_kernel(costs, series, runs, weights))
        check_if_fresh(
            slopes.built,
            lambda: check_sensitivities(slopes, self._sensitivities, series, runs, weights),
        )

    def write(self, series: Weights, *, watched: bool) -> None:
        """Replaces series by which runs start: of those that are watched, or trained on."""
        for data in (self._evaluation,) if watched else (self._train, self._train_costs):
            data.write(series)

    def products(self, runs: Runs, weights: Weights) -> dict[str, Products]:
        """Of every loss: products of its residuals and slopes."""
        physical = flat(self._program, weights)
        return self._slopes.products(self._train, runs.t0, runs.steps, physical)

    def train_costs(self, runs: Runs, weights: Weights) -> LossSums:
        """The losses of rollouts to train on."""
        return self._costs_on(self._train_costs, runs, weights)

    def watched_costs(self, runs: Runs, weights: Weights) -> LossSums:
        """The losses of rollouts on the rows that are watched."""
        return self._costs_on(self._evaluation, runs, weights)

    def _costs_on(self, data: KernelData, runs: Runs, weights: Weights) -> LossSums:
        kernel = self._costs
        groups = kernel.groups(runs.t0, runs.steps)
        physical = flat(self._program, weights)
        every = [1.0] * len(kernel.source.losses)
        found = kernel.losses(data, groups, physical, every, gradient=False)
        named = zip(kernel.source.losses, found.sums.tolist(), found.counts.tolist(), strict=True)
        return {name: LossSum(total, count) for name, total, count in named}
