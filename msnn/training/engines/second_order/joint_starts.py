"""Initial states of runs as unknowns of least squares with the parameters (decision 0430)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from backends.gauss_newton_products import Products, ProductsOfRuns
from compiler.differentiation.estimated_starts import (
    estimated_states,
    offset_parameter,
    start_signal,
    with_moved_starts,
)
from compiler.ir.program import State
from compiler.ir.types import Type
from msnn.data.dataset import FloatArray, IntArray
from msnn.data.starts import Runs
from msnn.training.engines.second_order.squares import SlopedSquares
from msnn.training.plans.stage_plan import StagePlan

Weights = Mapping[str, FloatArray]


class JointStarts:
    """The initial states of a stage's runs as one vector, and Jacobians with respect to it.

    A parameter with value 0 is added to all initial states. The derivative of one run with respect
    to it is the derivative with respect to the run's initial state.
    """

    def __init__(self, plan: StagePlan, series: Weights) -> None:
        assert plan.rollout.starts is not None
        self._rows = len(next(iter(series.values())))
        program = plan.rollout.starts.program
        self._states: tuple[State, ...] = estimated_states(program)
        self._sizes = [Type(state.axes).size for state in self._states]
        self.plan = replace(
            plan,
            rollout=replace(plan.rollout, program=with_moved_starts(program)),
            trained=(*plan.trained, *map(offset_parameter, self._states)),
        )
        """The stage whose Jacobians have columns for initial states after those of the
        parameters.
        """

    @property
    def numbers(self) -> int:
        """Number of elements in the initial state of one run."""
        return sum(self._sizes)

    def moved(self, weights: Weights) -> dict[str, FloatArray]:
        """The weights with the parameters that are added to initial states."""
        zeros = {offset_parameter(s): np.zeros(Type(s.axes).shape) for s in self._states}
        return {**weights, **zeros}

    def flat(self, series: Weights, t0: IntArray) -> FloatArray:
        """The initial states of runs as one vector, run after run."""
        parts = [series[start_signal(s.name)][t0].reshape(len(t0), -1) for s in self._states]
        return np.concatenate(parts, axis=1).ravel()

    def series(self, flat: FloatArray, t0: IntArray) -> dict[str, FloatArray]:
        """The series from which runs read these initial states."""
        found: dict[str, FloatArray] = {}
        for name, values in self.values(flat, len(t0)).items():
            # runs read their start at row t0 of a series; the other rows are never read
            whole = np.zeros((self._rows, *values.shape[1:]))
            whole[t0] = values
            found[start_signal(name)] = whole
        return found

    def values(self, flat: FloatArray, runs: int) -> dict[str, FloatArray]:
        """The initial states as (runs, *shape) per state."""
        parts = np.split(flat.reshape(runs, -1), np.cumsum(self._sizes)[:-1], axis=1)
        return {
            state.name: part.reshape(runs, *Type(state.axes).shape)
            for state, part in zip(self._states, parts, strict=True)
        }

    def products(self, squares: SlopedSquares, runs: Runs, weights: Weights) -> dict[str, Products]:
        """The products of every loss, with separate blocks for the initial state of each run."""
        return {name: one.all for name, one in self.of_each(squares, runs, weights).items()}

    def of_each(
        self, squares: SlopedSquares, runs: Runs, weights: Weights
    ) -> dict[str, ProductsOfRuns]:
        """The products of every loss with the sums of each run."""
        # summed over runs, it would be the derivative with respect to a common shift of all starts
        return squares.products_of_runs(runs, self.moved(weights), self.numbers)


_NOTHING = 1e-10
"""Curvature, relative to that of single variables, below which a direction is unidentifiable."""


def without_starts(
    products: Mapping[str, Products], shares: Mapping[str, float]
) -> tuple[dict[str, Products], dict[str, float]]:
    """Eliminates the initial states; returns the reduced products and the degrees of freedom used.

    With C = Σ cₗ KₗᵀKₗ and B = Σ cₗ JₗᵀKₗ of a run, the initial state follows a parameter change by
    −C⁺Bᵀ. The reduced Jacobian is Jₗ − KₗC⁺Bᵀ. A loss loses tr(C⁺ cₗ KₗᵀKₗ) degrees of freedom.
    """
    blocks = {name: one.starts for name, one in products.items() if one.starts is not None}
    cross = sum(share * blocks[name].cross for name, share in shares.items())
    own = sum(share * blocks[name].curvature for name, share in shares.items())
    inverse = inverted_blocks(np.asarray(own))
    follows = np.asarray(cross) @ inverse
    left: dict[str, Products] = {}
    used: dict[str, float] = {}
    for name, one in products.items():
        block = blocks[name]
        mixed = np.einsum("rpn,rqn->pq", follows, block.cross)
        within = np.einsum("rpn,rnm,rqm->pq", follows, block.curvature, follows)
        # (J − KC⁺Bᵀ)ᵀ(J − KC⁺Bᵀ) multiplied out, of which only products are known
        curvature = one.curvature - mixed - mixed.T + within
        left[name] = replace(one, curvature=curvature, starts=None)
        used[name] = shares.get(name, 0.0) * float(np.sum(inverse * block.curvature))
    return left, used


def inverted_blocks(blocks: FloatArray) -> FloatArray:
    """The pseudo-inverse of each block on its identifiable subspace."""
    diagonal = np.diagonal(blocks, axis1=1, axis2=2)
    # scale first: initial states have units, and the rank must not depend on them
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(blocks * scale[:, :, None] * scale[:, None, :])
    seen = values > _NOTHING
    kept = vectors * scale[:, :, None]
    return (kept * np.where(seen, 1.0 / np.where(seen, values, 1.0), 0.0)[:, None, :]) @ (
        kept.transpose(0, 2, 1)
    )
