"""Minimises sums of squares of many small problems in parallel by damped Gauss-Newton.

A step is −(JᵀJ)⁺Jᵀr with residuals r and Jacobian J. Variables are scaled to curvature 1, so that
the rank does not depend on units. The step is halved until F = rᵀr decreases (Björck, Numerical
Methods for Least Squares Problems, 1996, ch. 9).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray, IntArray

MOST_STEPS = 20

_NOTHING = 1e-10
"""Curvature, relative to that of single variables, below which a direction is undetermined."""

_PART = 1e-3
"""Minimum component with which a variable is reported as part of an undetermined direction."""

_LEAST_FALL = 1e-16
"""Minimum predicted relative decrease of F: variables are then within 1e-8 of their standard
error.
"""

_UNSEEN = 1e-12
"""Relative increase of F that rounding may cause."""

_ROUNDING = 1e-24
"""The same relative to the squares of the targets, if F consists of rounding errors only."""


@dataclass(frozen=True, slots=True)
class RunProducts:
    """For each problem: F = rᵀr, Jᵀr, JᵀJ, and the sum of squared targets."""

    squares: FloatArray
    slope: FloatArray
    curvature: FloatArray
    size: FloatArray

    def __add__(self, other: RunProducts) -> RunProducts:
        return RunProducts(
            self.squares + other.squares,
            self.slope + other.slope,
            self.curvature + other.curvature,
            self.size + other.size,
        )

    def take(self, members: IntArray) -> RunProducts:
        return RunProducts(
            self.squares[members], self.slope[members], self.curvature[members], self.size[members]
        )


@dataclass(frozen=True, slots=True)
class Descended:
    """The solution of each problem, and flags of those that did not converge or are not unique."""

    values: FloatArray
    """(problems, variables)."""
    settled: BoolArray
    """Converged problems; false if the squares are not finite."""
    undecided: BoolArray
    """(problems, variables): variables that take part in an undetermined direction."""


def descended(
    begin: FloatArray, products: Callable[[IntArray, FloatArray], RunProducts]
) -> Descended:
    """Minimises every problem from `begin`, (problems, variables), in at most MOST_STEPS steps.

    `products` computes the residuals' products of the problems with the given indices at given
    values.
    """
    values = begin.copy()
    everything = np.arange(len(begin))
    undecided = np.zeros(begin.shape, np.bool_)
    settled = np.zeros(len(begin), np.bool_)
    # of those that have not ended; all arrays of a problem move along in this order
    now, members = products(everything, values), everything
    length = np.ones(len(begin))
    for taken in range(MOST_STEPS + 1):
        step, fall, nothing = _steps(now)
        # from the last step that a problem took part in: those that ended keep theirs
        undecided[members] = nothing
        finite = np.isfinite(now.squares)
        # of infinite squares any fall would be a small part
        done = finite & (fall <= _LEAST_FALL * now.squares + _ROUNDING * now.size)
        settled[members] = done
        left = np.flatnonzero(~done & finite)
        if not len(left) or taken == MOST_STEPS:
            break
        members, now, step, length = members[left], now.take(left), step[left], length[left]
        trial = values[members] + length[:, None] * step
        after = products(members, trial)
        better = after.squares <= (1.0 + _UNSEEN) * now.squares  # false for NaN
        values[members[better]] = trial[better]
        now = _chosen(better, after, now)
        # a shorter step is tried from the same values; after one that helps the next may be longer
        # again
        length = np.where(better, np.minimum(2.0 * length, 1.0), 0.5 * length)
    return Descended(values, settled, undecided)


def decided_directions(curvature: FloatArray) -> IntArray:
    """The rank of every problem: the number of directions that change its residuals."""
    return np.sum(_scaled_eigenvalues(curvature)[0] > _NOTHING, axis=1)


def _scaled_eigenvalues(curvature: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Eigenvalues, eigenvectors, and the scales that make each variable's curvature 1."""
    # the decomposition of one problem that is not finite would fail for all
    finite = np.where(np.isfinite(curvature), curvature, 0.0)
    diagonal = np.diagonal(finite, axis1=1, axis2=2)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, directions = np.linalg.eigh(finite * scale[:, :, None] * scale[:, None, :])
    return values, directions, scale


def _steps(now: RunProducts) -> tuple[FloatArray, FloatArray, BoolArray]:
    """The full step of each problem, the predicted decrease, and undetermined variables."""
    slope = np.where(np.isfinite(now.slope), now.slope, 0.0)
    # eigenvalues say which directions decide: those without curvature get no step, as in the
    # pseudoinverse
    found, directions, scale = _scaled_eigenvalues(now.curvature)
    decides = found > _NOTHING
    along = np.einsum("rni,rn->ri", directions, slope * scale)
    shares = np.where(decides, along / np.where(decides, found, 1.0), 0.0)
    step = -scale * np.einsum("rni,ri->rn", directions, shares)
    # squares of each number's part in the directions that nothing decides
    lost = np.where(decides[:, None, :], 0.0, directions * directions).sum(axis=2)
    # a whole step s = −A⁺g takes gᵀA⁺g off the model, F + 2gᵀs + sᵀAs
    return step, np.sum(shares * np.where(decides, along, 0.0), axis=1), lost > _PART * _PART


def _chosen(which: BoolArray, one: RunProducts, other: RunProducts) -> RunProducts:
    return RunProducts(
        np.where(which, one.squares, other.squares),
        np.where(which[:, None], one.slope, other.slope),
        np.where(which[:, None, None], one.curvature, other.curvature),
        np.where(which, one.size, other.size),
    )
