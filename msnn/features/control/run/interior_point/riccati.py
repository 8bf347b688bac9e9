"""Solves the quadratic problem of one Newton step by a Riccati recursion over the stages.

    min Σ_k ½ wᵀ H_k w + g_kᵀ w,   w = (dx_k, du_k)
    dx_{k+1} = A_k dx_k + B_k du_k + c_k,   dx_0 = 0

Where a block goes on, u_k is u_{k−1}, which x_k holds: there is nothing to decide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError
from numpy.typing import NDArray

from msnn.features.control.problem.optimal_control.horizon import Array

LEAST_CURVATURE = 1e-12
"""Of a control, relative to the largest of its stage."""


@dataclass(frozen=True, slots=True)
class HeldControls:
    """The stages whose controls are those of the stage before: du_k = selection · dx_k + gaps."""

    stages: NDArray[np.bool_]
    """(N), whether it is one."""
    selection: Array
    """(nu, nx)"""

    def gaps(self, states: Array, controls: Array) -> Array:
        """The distances of controls from those that the states hold, (N, nu)."""
        return states[:-1] @ self.selection.T - controls


def newton_step(
    hessian: Array,
    gradient: Array,
    slopes: Array,
    gaps: Array,
    held: HeldControls,
    held_gaps: Array,
) -> tuple[Array, Array] | None:
    """Changes of states (N+1, nx) and of controls (N, nu).

    None where the problem has no minimum: some control has no curvature. `slopes` are (A, B) side
    by side, (N, nx, nx+nu); `gaps` are c.
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
    """Gain and offset of the control that is best from any state."""
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
