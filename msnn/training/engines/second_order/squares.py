"""Defines what second-order methods ask of a stage: residuals, their slopes, their costs."""

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
    """The losses of a stage as sums of squares with their slopes, at any weights, in float64."""

    def check(self, runs: Runs, weights: Mapping[str, FloatArray]) -> None:
        """Compares what was built for this stage with the interpreter. Raises WrongKernelError."""
        ...

    def write(self, series: Mapping[str, FloatArray], *, watched: bool) -> None:
        """Replaces series by which runs start: of those that are watched, or trained on."""
        ...

    def products(self, runs: Runs, weights: Mapping[str, FloatArray]) -> dict[str, Products]:
        """The products of residuals and slopes of every loss, in the numbers of `plan.trained`."""
        ...

    def products_of_runs(
        self, runs: Runs, weights: Mapping[str, FloatArray], own: int
    ) -> dict[str, ProductsOfRuns]:
        """The same, the last `own` numbers of every run apart, in the order of the runs."""
        ...


class Squares(SlopedSquares, Protocol):
    """The same with the losses alone, for those who try steps."""

    def __init__(
        self,
        plan: StagePlan,
        series: Mapping[str, FloatArray],
        train_rows: RowsByLoss | None,
        evaluation_rows: RowsByLoss | None,
    ) -> None: ...

    def train_costs(self, runs: Runs, weights: Mapping[str, FloatArray]) -> LossSums:
        """The losses of rollouts to train on."""
        ...

    def watched_costs(self, runs: Runs, weights: Mapping[str, FloatArray]) -> LossSums:
        """The losses of rollouts on the rows that are watched."""
        ...


def loss_sums_of(products: Mapping[str, Products]) -> LossSums:
    """The losses that came with their products."""
    return {name: LossSum(one.cost, one.count) for name, one in products.items()}
