"""Distributes the rollouts of least squares over processes, and sums their products."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from backends.gauss_newton_products import Products
from backends.native.kernel import Ranks, added_by
from msnn.data.starts import Runs


def own_runs(runs: Runs, ranks: Ranks) -> Runs:
    """The consecutive rollouts of this rank, with about the same number of steps on each rank."""
    before = np.cumsum(runs.steps) - runs.steps
    total = int(runs.steps.sum())
    first, end = (
        int(np.searchsorted(before * ranks.count, rank * total))
        for rank in (ranks.rank, ranks.rank + 1)
    )
    return runs.take(np.arange(first, end))


def no_products(numbers: int) -> Products:
    """The products of an empty set of rollouts."""
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
