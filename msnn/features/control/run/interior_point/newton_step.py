"""Solves the quadratic problem of a Newton step: by a Riccati recursion, or condensed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError
from numpy.typing import NDArray

from msnn.features.control.problem.horizon import Array

LEAST_CURVATURE = 1e-12
"""Of a control, relative to the largest of its stage."""


@dataclass(frozen=True, slots=True)
class HeldControls:
    """The stages within a block, whose controls equal those of the previous stage: du_k = selection
    · dx_k + gaps.
    """

    stages: NDArray[np.bool_]
    """(N), whether it is one."""
    selection: Array
    """(nu, nx)"""

    def gaps(self, states: Array, controls: Array) -> Array:
        """The differences between the previous controls, which the states contain, and the
        controls, (N, nu).
        """
        return states[:-1] @ self.selection.T - controls


def newton_step(
    hessian: Array,
    gradient: Array,
    slopes: Array,
    gaps: Array,
    held: HeldControls,
    held_gaps: Array,
) -> tuple[Array, Array] | None:
    """The minimum of a quadratic problem by a Riccati recursion: changes of states dx (N+1, nx) and
    of controls du (N, nu).

    Stage k costs ½ wᵀ H w + gᵀ w with w = (dx_k, du_k), H in `hessian` and g in `gradient`;
    dx_{k+1} = A dx_k + B du_k + c. `slopes` are (A, B) side by side, (N, nx, nx+nu); `gaps` are c.
    `held_gaps` are those of held controls, (N, nu). None if the problem has no minimum, because a
    control has no curvature.
    """
    n, nx, width = slopes.shape
    value, linear = hessian[n, :nx, :nx], gradient[n, :nx]
    gains, offsets = np.zeros((n, width - nx, nx)), np.zeros((n, width - nx))
    for k in range(n - 1, -1, -1):
        # of the costs to go: what stage k+1 costs, seen from (dx_k, du_k)
        quadratic = hessian[k] + slopes[k].T @ value @ slopes[k]
        slope = gradient[k] + slopes[k].T @ (value @ gaps[k] + linear)
        # nothing to decide: the control follows the state
        if held.stages[k]:
            gains[k], offsets[k] = held.selection, held_gaps[k]
        else:
            found = _best_control(quadratic, slope, nx)
            if found is None:
                return None
            gains[k], offsets[k] = found
        # [I; K]: the cost to go along the control that was found
        along = np.concatenate([np.eye(nx), gains[k]])
        value = along.T @ quadratic @ along
        # rounding lets the triangles drift apart along a long horizon
        value = (value + value.T) / 2
        linear = along.T @ (slope + quadratic[:, nx:] @ offsets[k])
    states, controls = np.zeros((n + 1, nx)), np.zeros((n, width - nx))
    for k in range(n):
        controls[k] = gains[k] @ states[k] + offsets[k]
        states[k + 1] = slopes[k] @ np.concatenate([states[k], controls[k]]) + gaps[k]
    return states, controls


def _best_control(quadratic: Array, slope: Array, nx: int) -> tuple[Array, Array] | None:
    """Gain K and offset k of the optimal control du = K dx + k of a stage with this quadratic and
    linear cost; None without a minimum.
    """
    own = quadratic[nx:, nx:]
    try:
        # positive definite, or the stage has no best control
        factor = np.linalg.cholesky(own)
    except LinAlgError:
        return None
    # pivots of rounding count as none
    if not np.all(np.diagonal(factor) ** 2 > LEAST_CURVATURE * np.max(np.abs(own))):
        return None
    # gain and offset are one system with nx + 1 right sides
    right = np.concatenate([quadratic[nx:, :nx], slope[nx:, None]], axis=1)
    found: Array = -np.linalg.solve(own, right).astype(np.float64)
    return found[:, :nx], found[:, nx]


def condensed_step(
    hessian: Array,
    gradient: Array,
    slopes: Array,
    gaps: Array,
    held: HeldControls,
    held_gaps: Array,
) -> tuple[Array, Array] | None:
    """The same changes as `newton_step` (arguments as there), by one dense system in the controls
    alone: changes of states (N+1, nx) and of controls (N, nu).

    None if the problem has no minimum, because a direction of the controls has no curvature.
    """
    n, nx, width = slopes.shape
    nu = width - nx
    decided = np.flatnonzero(~held.stages)
    count = nu * len(decided)
    along = np.zeros((n + 1, width, count + 1))  # the last column: what happens by itself
    first = 0
    for k in range(n):
        if held.stages[k]:
            # decided earlier: u_k moves with the state that holds u_{k−1}
            along[k, nx:] = held.selection @ along[k, :nx]
            along[k, nx:, count] += held_gaps[k]
        else:
            along[k, nx:, first : first + nu] = np.eye(nu)
            first += nu
        # the plant's slopes carry each decided control, and the column of what happens by itself,
        # on
        along[k + 1, :nx] = slopes[k] @ along[k]
        along[k + 1, :nx, count] += gaps[k]
    bent = hessian @ along
    # Σ_k of both sides: the quadratic form in v, and in its last column what v meets
    whole: Array = np.tensordot(along, bent, axes=([0, 1], [0, 1]))
    linear: Array = whole[:count, count] + np.einsum("kwv,kw->v", along[:, :, :count], gradient)
    own: Array = (whole[:count, :count] + whole[:count, :count].T) / 2
    try:
        factor = np.linalg.cholesky(own)
    except LinAlgError:
        return None
    # Cholesky goes through down to rounding: a direction without curvature is told by its pivot
    if not np.all(np.diagonal(factor) ** 2 > LEAST_CURVATURE * np.max(np.abs(own), initial=0.0)):
        return None
    best: Array = np.linalg.solve(own, -linear).astype(np.float64)
    # the last column counts once
    found = np.concatenate([best, np.ones(1)])
    moves: Array = along @ found
    return moves[:, :nx], moves[:n, nx:]


def convex(hessian: Array) -> Array:
    """The nearest symmetric matrices with positive eigenvalues, one per stage."""
    values, vectors = np.linalg.eigh(hessian)
    # flat directions count as bent a little: their step would be endless
    least = 1e-8 * np.maximum(1.0, np.max(np.abs(values), axis=1, keepdims=True))
    return np.einsum("kij,kj,klj->kil", vectors, np.maximum(values, least), vectors)
