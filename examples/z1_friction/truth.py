"""Computes the true joint friction of the arm that `generate_data.py` simulates.

    f = K_v(q) q̇ + tanh(20 q̇) (K_c(q) + (K_s(q) − K_c(q)) exp(−(q̇ / w_s(q))²))

Every coefficient depends on the configuration: K(q) = K₀ (1 + a sin(q + φ) + 0.2 a sin(2 q + ψ)).
The second harmonic is not in the span of 1, sin q, cos q, which the model learns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHARPNESS = 20.0
"""Of the smoothed sign, in s/rad."""
_MEANS = {
    "viscous": np.array([1.2, 1.8, 1.2, 0.6, 0.5, 0.35]),
    "coulomb": np.array([1.0, 1.6, 1.1, 0.6, 0.5, 0.35]),
    "static": np.array([1.6, 2.5, 1.7, 1.0, 0.8, 0.55]),
    "stribeck": np.array([0.25, 0.25, 0.25, 0.3, 0.3, 0.3]),
}
_SWINGS = {"viscous": 0.35, "coulomb": 0.3, "static": 0.3, "stribeck": 0.2}
_PHASES = {
    name: np.random.default_rng(11 + index).uniform(0, 2 * np.pi, (2, 6))
    for index, name in enumerate(_MEANS)
}


def coefficients(q: Array) -> dict[str, Array]:
    """K_v, K_c, K_s and w_s of each joint at positions (…, 6)."""
    found: dict[str, Array] = {}
    for name, mean in _MEANS.items():
        first, second = _PHASES[name]
        wave = np.sin(q + first) + 0.2 * np.sin(2 * q + second)
        found[name] = mean * (1 + _SWINGS[name] * wave)
    return found


def friction(q: Array, dq: Array) -> Array:
    """The torque that friction takes at positions and speeds (…, 6), in N m."""
    k = coefficients(q)
    rise = (k["static"] - k["coulomb"]) * np.exp(-((dq / k["stribeck"]) ** 2))
    return k["viscous"] * dq + np.tanh(SHARPNESS * dq) * (k["coulomb"] + rise)
