"""Defines the interface for second-order methods: residuals, Jacobians and costs of a stage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from backends.gauss_newton_products import Products, ProductsOfRuns
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.starts import Runs
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import LossSums
from msnn.training.plans.stage_plan import StagePlan

RowsByLoss = Mapping[str, BoolArray]


class SlopedSquares(Protocol):
    """The losses of a stage as sums of squares with Jacobians, at any weights, in float64."""

    def check(self, runs: Runs, weights: Mapping[str, FloatArray]) -> None:
        """Compares the kernels of this stage with the reference interpreter. Raises
        WrongKernelError.
        """
        ...

    def write(self, series: Mapping[str, FloatArray], *, watched: bool) -> None:
        """Replaces the series with the start values of runs, either of watched or of training
        runs.
        """
        ...

    def products(self, runs: Runs, weights: Mapping[str, FloatArray]) -> dict[str, Products]:
        """JᵀJ and Jᵀr of every loss, with respect to the elements of `plan.trained`."""
        ...

    def products_of_runs(
        self, runs: Runs, weights: Mapping[str, FloatArray], own: int
    ) -> dict[str, ProductsOfRuns]:
        """The same, with separate blocks for the last `own` variables of every run, in order of
        runs.
        """
        ...


class Squares(SlopedSquares, Protocol):
    """The same, and losses without derivatives for trial steps."""

    def __init__(
        self,
        plan: StagePlan,
        series: Mapping[str, FloatArray],
        train_rows: RowsByLoss | None,
        evaluation_rows: RowsByLoss | None,
    ) -> None: ...

    def train_costs(self, runs: Runs, weights: Mapping[str, FloatArray]) -> LossSums:
        """The losses of training rollouts."""
        ...

    def watched_costs(self, runs: Runs, weights: Mapping[str, FloatArray]) -> LossSums:
        """The losses of rollouts on the watched rows."""
        ...


def loss_sums_of(products: Mapping[str, Products]) -> LossSums:
    """The losses contained in the products."""
    return {name: LossSum(one.cost, one.count) for name, one in products.items()}
