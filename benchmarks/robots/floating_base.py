"""Translates between the speeds of a floating base here and the twists of other programs.

Here a base has the coordinates x, y, z, roll φ, pitch θ, yaw ψ with R = Rz(ψ) Ry(θ) Rx(φ), and its
speeds are their derivatives. Others have ω, the angular velocity, in place of the last three:

    ω = E(φ, θ, ψ) (φ̇, θ̇, ψ̇),  v = T ẋ with T = diag(1, E, 1)

so that v̇ = T ẍ + Ṫ ẋ, and generalised forces are τ_ẋ = Tᵀ τ_v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ANGLES = slice(3, 6)


@dataclass(frozen=True)
class Twist:
    """The matrices that convert speeds of the base in one state: E and its derivative Ė."""

    rotation: Array
    E: Array
    slope: Array

    def speeds(self, dx: Array) -> Array:
        """v from ẋ."""
        return self._turned(self.E, dx)

    def forces(self, torques: Array) -> Array:
        """τ_v from τ_ẋ."""
        return self._turned(np.linalg.inv(self.E).T, torques)

    def accelerations(self, dv: Array, dx: Array) -> Array:
        """ẍ from v̇."""
        left = dv.copy()
        left[ANGLES] -= self.slope @ dx[ANGLES]
        return self._turned(np.linalg.inv(self.E), left)

    def _turned(self, matrix: Array, values: Array) -> Array:
        found = values.copy()
        found[ANGLES] = matrix @ values[ANGLES]
        return found


def twist(x: Array, dx: Array, *, of_body: bool) -> Twist:
    """The conversion of speeds of the base at coordinates x and speeds ẋ.

    ω is along the axes of the body if `of_body`, else of the world.
    """
    (sf, st, sp), (cf, ct, cp) = np.sin(x[ANGLES]), np.cos(x[ANGLES])
    df, dt, dp = dx[ANGLES]
    yaw = np.array([[cp, -sp, 0], [sp, cp, 0], [0, 0, 1]])
    pitch = np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
    roll = np.array([[1, 0, 0], [0, cf, -sf], [0, sf, cf]])
    rotation = yaw @ pitch @ roll
    if of_body:
        columns = ((1, 0, 0), (0, cf, -sf), (-st, sf * ct, cf * ct))
        slopes = (
            (0, 0, 0),
            (0, -sf * df, -cf * df),
            (-ct * dt, cf * ct * df - sf * st * dt, -sf * ct * df - cf * st * dt),
        )
    else:
        columns = ((cp * ct, sp * ct, -st), (-sp, cp, 0), (0, 0, 1))
        slopes = (
            (-sp * ct * dp - cp * st * dt, cp * ct * dp - sp * st * dt, -ct * dt),
            (-cp * dp, -sp * dp, 0),
            (0, 0, 0),
        )
    return Twist(rotation, np.transpose(np.array(columns)), np.transpose(np.array(slopes)))
