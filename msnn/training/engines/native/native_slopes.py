"""Computes residuals and their Jacobians with a kernel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from backends.gauss_newton_products import Products, ProductsOfRuns, joined_runs
from backends.native.sensitivity_kernel import SensitivityKernel
from backends.native.variables import flat
from compiler.differentiation.sensitivities import sensitivities
from compiler.differentiation.sums_of_squares import with_compared_squares
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.starts import Runs
from msnn.simulation.engines.kernel_check import check_sensitivities
from msnn.simulation.engines.kernel_trials import check_if_fresh
from msnn.training.engines.own_series import own_series
from msnn.training.engines.shared_products import no_products, own_runs, summed_products
from msnn.training.plans.stage_plan import StagePlan

Weights = Mapping[str, FloatArray]


class NativeSlopes:
    """Computes Jacobians with one kernel. Raises CompilerMissingError and StackTooSmallError."""

    def __init__(
        self, plan: StagePlan, series: Weights, train_rows: Mapping[str, BoolArray] | None
    ) -> None:
        self._ranks = plan.ranks
        self._program = with_compared_squares(plan.rollout.program)
        self._series = series = own_series(plan, series)
        self._found = sensitivities(self._program, plan.trained)
        self._kernel = SensitivityKernel(self._found)
        self._train = self._kernel.data(own_series(plan, series), plan.train_skip, train_rows)

    def check(self, runs: Runs, weights: Weights) -> None:
        """Compares a newly built kernel with the reference interpreter. Raises WrongKernelError."""
        kernel, found, series = self._kernel, self._found, self._series
        check_if_fresh(
            kernel.built, lambda: check_sensitivities(kernel, found, series, runs, weights)
        )

    def write(self, series: Weights, *, watched: bool) -> None:
        """Replaces the series with the start values of training runs."""
        if not watched:
            self._train.write(series)

    def products(self, runs: Runs, weights: Weights) -> dict[str, Products]:
        """JᵀJ and Jᵀr of every loss, with residuals r and Jacobian J."""
        physical = flat(self._program, weights)
        if self._ranks is None:
            return self._kernel.products(self._train, runs.t0, runs.steps, physical)
        own = own_runs(runs, self._ranks)
        # fewer runs than ranks: who has none still takes part in the sum
        if len(own):
            found = self._kernel.products(self._train, own.t0, own.steps, physical)
        else:
            found = {loss.name: no_products(self._kernel.numbers) for loss in self._program.losses}
        return summed_products(found, self._ranks)

    def products_of_runs(self, runs: Runs, weights: Weights, own: int) -> dict[str, ProductsOfRuns]:
        """The same products, with separate blocks for the last `own` variables of every run."""
        if self._ranks is not None:  # one run after the other is shared out and summed
            each = [self.products(runs.take(np.array([i])), weights) for i in range(len(runs))]
            return {name: joined_runs([run[name] for run in each], own) for name in each[0]}
        physical = flat(self._program, weights)
        return self._kernel.products_of_runs(self._train, runs.t0, runs.steps, physical, own)
