"""Computes residuals, Jacobians and costs with kernels, in one or several processes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from backends.gauss_newton_products import Products, ProductsOfRuns, joined_runs
from backends.native.kernel import Kernel, Ranks, added_by
from backends.native.kernel_data import KernelData
from backends.native.sensitivity_kernel import SensitivityKernel
from backends.native.variables import flat
from compiler.differentiation.sensitivities import sensitivities
from compiler.differentiation.sums_of_squares import with_compared_squares
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.engines.kernel_check import check_if_fresh, check_kernel, check_sensitivities
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import LossSums, own_series
from msnn.training.plans.stage_plan import StagePlan

Weights = Mapping[str, FloatArray]


class NativeSquares:
    """Least squares of a stage by two C kernels: one for Jacobians, one for losses alone.

    Raises CompilerMissingError if there is no C compiler.
    """

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
        """Overwrites the series of initial states (see `Engine.write`)."""
        self._slopes.write(series, watched=watched)
        (self._evaluation if watched else self._train).write(series)

    def products(self, runs: Runs, weights: Weights) -> dict[str, Products]:
        """JᵀJ and Jᵀr of every loss, with residuals r and Jacobian J."""
        return self._slopes.products(runs, weights)

    def products_of_runs(self, runs: Runs, weights: Weights, own: int) -> dict[str, ProductsOfRuns]:
        """The same products, separately for each rollout in the last `own` variables, its initial
        states.
        """
        return self._slopes.products_of_runs(runs, weights, own)

    def train_costs(self, runs: Runs, weights: Weights) -> LossSums:
        """The losses of training rollouts, without derivatives."""
        return self._costs_on(self._train, runs, weights)

    def watched_costs(self, runs: Runs, weights: Weights) -> LossSums:
        """The losses of rollouts on the rows of the monitor's set, without derivatives."""
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


class NativeSlopes:
    """Residuals and Jacobians of a stage by a C kernel, shared among the processes of a training.

    Raises CompilerMissingError, and StackTooSmallError if the kernel needs more stack than there
    is.
    """

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
        """Overwrites the series of initial states of training rollouts; does nothing if
        `watched`.
        """
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
        """The same products, separately for each rollout in the last `own` variables, its initial
        states.
        """
        if self._ranks is not None:  # one run after the other is shared out and summed
            each = [self.products(runs.take(np.array([i])), weights) for i in range(len(runs))]
            return {name: joined_runs([run[name] for run in each], own) for name in each[0]}
        physical = flat(self._program, weights)
        return self._kernel.products_of_runs(self._train, runs.t0, runs.steps, physical, own)


def own_runs(runs: Runs, ranks: Ranks) -> Runs:
    """The consecutive rollouts that this process computes; each process gets about the same number
    of steps.
    """
    before = np.cumsum(runs.steps) - runs.steps
    total = int(runs.steps.sum())
    first, end = (
        int(np.searchsorted(before * ranks.count, rank * total))
        for rank in (ranks.rank, ranks.rank + 1)
    )
    return runs.take(np.arange(first, end))


def no_products(numbers: int) -> Products:
    """Products that are all 0: those of no rollouts, for `numbers` variables."""
    return Products(
        curvature=np.zeros((numbers, numbers)),
        slope=np.zeros(numbers),
        squares=0.0,
        cost=0.0,
        count=0.0,
    )


def summed_products(own: Mapping[str, Products], ranks: Ranks) -> dict[str, Products]:
    """The products summed over all ranks in rank order: the same bits on each."""
    parts = [_flat(one) for one in own.values()]
    whole = np.split(added_by(ranks, np.concatenate(parts)), len(parts))
    return {
        name: _shaped(numbers, len(one.slope))
        for (name, one), numbers in zip(own.items(), whole, strict=True)
    }


def _flat(one: Products) -> np.ndarray:
    scalars = (one.squares, one.cost, one.count, one.left_out)
    return np.concatenate([one.curvature.ravel(), one.slope, scalars])


def _shaped(flat: np.ndarray, numbers: int) -> Products:
    curvature, slope, scalars = np.split(flat, [numbers * numbers, numbers * numbers + numbers])
    squares, cost, count, left_out = map(float, scalars)
    shaped = curvature.reshape(numbers, numbers)
    return Products(
        curvature=shaped, slope=slope, squares=squares, cost=cost, count=count, left_out=left_out
    )
