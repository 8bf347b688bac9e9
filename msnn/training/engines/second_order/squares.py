"""Defines the least squares of a stage: residuals, Jacobians, and the vector of its unknowns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from backends.gauss_newton_products import Products, ProductsOfRuns
from backends.raw_parameters import physical_slope, physical_value, raw_value
from compiler.differentiation.estimated_starts import (
    estimated_states,
    offset_parameter,
    start_signal,
    with_moved_starts,
)
from compiler.ir.program import Parameter, State
from compiler.ir.types import Type
from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import LossSums
from msnn.training.plans.stage_plan import StagePlan

RowsByLoss = Mapping[str, BoolArray]


class SlopedSquares(Protocol):
    """Residuals of a stage and their Jacobians, in float64, for second-order optimisers.

    `NativeSlopes` and `TorchSquares` have these methods. `weights` are physical values by name.
    """

    def check(self, runs: Runs, weights: Mapping[str, FloatArray]) -> None:
        """Compares kernels, if any, with the reference interpreter.

        Raises WrongKernelError if they differ.
        """
        ...

    def write(self, series: Mapping[str, FloatArray], *, watched: bool) -> None:
        """Overwrites the series of initial states (see `Engine.write`)."""
        ...

    def products(self, runs: Runs, weights: Mapping[str, FloatArray]) -> dict[str, Products]:
        """JᵀJ and Jᵀr of every loss: r are the residuals, J their derivatives in the elements of
        `plan.trained`.
        """
        ...

    def products_of_runs(
        self, runs: Runs, weights: Mapping[str, FloatArray], own: int
    ) -> dict[str, ProductsOfRuns]:
        """The same, separately for each rollout in the last `own` variables, which are its initial
        states.
        """
        ...


class Squares(SlopedSquares, Protocol):
    """Residuals with Jacobians, and losses without derivatives, to evaluate trial steps."""

    def __init__(
        self,
        plan: StagePlan,
        series: Mapping[str, FloatArray],
        train_rows: RowsByLoss | None,
        evaluation_rows: RowsByLoss | None,
    ) -> None: ...

    def train_costs(self, runs: Runs, weights: Mapping[str, FloatArray]) -> LossSums:
        """The losses of training rollouts at these weights."""
        ...

    def watched_costs(self, runs: Runs, weights: Mapping[str, FloatArray]) -> LossSums:
        """The losses of rollouts at these weights, on the rows of the monitor's set."""
        ...


def loss_sums_of(products: Mapping[str, Products]) -> LossSums:
    """The value of each loss, as its sum and count, from products that also have derivatives."""
    return {name: LossSum(one.cost, one.count) for name, one in products.items()}


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
        """The weights, and a parameter 0 for each initial state, to which the program adds it."""
        zeros = {offset_parameter(s): np.zeros(Type(s.axes).shape) for s in self._states}
        return {**weights, **zeros}

    def flat(self, series: Weights, t0: IntArray) -> FloatArray:
        """The initial states of runs as one vector, run after run."""
        parts = [series[start_signal(s.name)][t0].reshape(len(t0), -1) for s in self._states]
        return np.concatenate(parts, axis=1).ravel()

    def series(self, flat: FloatArray, t0: IntArray) -> dict[str, FloatArray]:
        """The series (rows, *shape) from which rollouts read their initial states, at their start
        rows `t0`.

        `flat` has the initial states as one vector, run after run.
        """
        found: dict[str, FloatArray] = {}
        for name, values in self.values(flat, len(t0)).items():
            # runs read their start at row t0 of a series; the other rows are never read
            whole = np.zeros((self._rows, *values.shape[1:]))
            whole[t0] = values
            found[start_signal(name)] = whole
        return found

    def values(self, flat: FloatArray, runs: int) -> dict[str, FloatArray]:
        """Splits the vector `flat` of all initial states into an array (runs, *shape) for each
        state.
        """
        parts = np.split(flat.reshape(runs, -1), np.cumsum(self._sizes)[:-1], axis=1)
        return {
            state.name: part.reshape(runs, *Type(state.axes).shape)
            for state, part in zip(self._states, parts, strict=True)
        }

    def products(self, squares: SlopedSquares, runs: Runs, weights: Weights) -> dict[str, Products]:
        """The products of every loss over all rollouts, with one block per rollout for its initial
        state.
        """
        return {name: one.all for name, one in self.of_each(squares, runs, weights).items()}

    def of_each(
        self, squares: SlopedSquares, runs: Runs, weights: Weights
    ) -> dict[str, ProductsOfRuns]:
        """The products of every loss, separately for each rollout in its initial state."""
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


class LearnedNumbers:
    """Converts between the parameters that a stage trains and one vector of raw variables.

    The vector has the elements of one parameter after the other; elements behind them are ignored.
    """

    def __init__(self, parameters: Sequence[Parameter], given: Mapping[str, FloatArray]) -> None:
        self._parameters, self._given = parameters, dict(given)
        sizes = [self._given[p.name].size for p in parameters]
        self._ends = np.cumsum(sizes, dtype=np.int64)

    def begin(self) -> tuple[FloatArray, tuple[str, ...]]:
        """The raw variables of the given weights, and names of parameters that were moved off a
        bound.

        At a bound the raw variable would be infinite.
        """
        raws = [raw_value(p, self._given[p.name]) for p in self._parameters]
        moved = tuple(p.name for p, (_, off) in zip(self._parameters, raws, strict=True) if off)
        return np.concatenate([raw.ravel() for raw, _ in raws]), moved

    def weights(self, raw: FloatArray) -> dict[str, FloatArray]:
        """Physical values of all parameters; parameters that are not learned keep their given
        values.
        """
        weights = dict(self._given)
        for parameter, part in self.parts(raw):
            weights[parameter.name] = physical_value(parameter, part)
        return weights

    def slopes(self, raw: FloatArray) -> FloatArray:
        """The derivatives of physical values with respect to their raw variables."""
        return np.concatenate([physical_slope(p, part).ravel() for p, part in self.parts(raw)])

    def parts(self, raw: FloatArray) -> list[tuple[Parameter, FloatArray]]:
        """Each parameter with its section of a vector, reshaped to the parameter's shape."""
        parts = np.split(raw[: int(self._ends[-1])], self._ends[:-1])
        return [
            (parameter, part.reshape(self._given[parameter.name].shape))
            for parameter, part in zip(self._parameters, parts, strict=True)
        ]
