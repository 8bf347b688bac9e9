"""Solves the quadratic problem of one Newton step in the controls alone.

With the states eliminated, dx_k = S_k v + s_k, du_k = T_k v + t_k, where v are the controls that
are decided: all, or the first of each block. What remains of the problem of `riccati` is

    min ½ vᵀ H v + gᵀ v,   H = Σ_k (S_k; T_k)ᵀ H_k (S_k; T_k)
"""

from __future__ import annotations

import numpy as np
from numpy.linalg import LinAlgError

from msnn.features.control.problem.optimal_control.horizon import Array
from msnn.features.control.run.interior_point.riccati import LEAST_CURVATURE, HeldControls


def condensed_step(
    hessian: Array,
    gradient: Array,
    slopes: Array,
    gaps: Array,
    held: HeldControls,
    held_gaps: Array,
) -> tuple[Array, Array] | None:
    """Changes of states (N+1, nx) and of controls (N, nu), as `newton_step` finds them.

    None where the problem has no minimum: some direction of the controls has no curvature.
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
