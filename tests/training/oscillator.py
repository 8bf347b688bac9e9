"""An oscillator of which only the position is measured: records from random starts, with noise."""

from __future__ import annotations

import numpy as np

from msnn.data.dataset import FloatArray

STEP = 0.05
TRUE = {"k": np.array(5.0), "d": np.array(0.2)}
NOISE = 0.02

SPEC = """
msnn: 1
name: oscillator
sample_time: 50 ms
inputs: {{u: N}}
targets: {{q: m}}
constants: {{m: 1 kg}}
parameters:
  k: {{init: 6, unit: N/m, min: 0 N/m}}
  d: {{init: 0.3, unit: N*s/m, min: 0 N*s/m}}
states:
  x: {{unit: m, der: v, init: {x}}}
  v: {{unit: m/s, der: "(u - k*x - d*v)/m", init: {v}}}
integrator: rk4
outputs: {{y: {{expr: x, predicts: q, unit: m}}}}
"""
FITTED = SPEC.format(x="{fit: {over: 2 s, from: q.meas}}", v="{fit: {over: 40}}")
FROM_REST = SPEC.format(x="q.meas", v="0")


def step(k: float, d: float, state: FloatArray, u: float) -> FloatArray:
    """One step of Runge and Kutta from (x, v)."""

    def slope(s: FloatArray) -> FloatArray:
        return np.array([s[1], u - k * s[0] - d * s[1]])

    a = slope(state)
    b = slope(state + STEP / 2 * a)
    c = slope(state + STEP / 2 * b)
    e = slope(state + STEP * c)
    return state + STEP / 6 * (a + 2 * b + 2 * c + e)


def positions(k: float, d: float, state: FloatArray, u: FloatArray) -> FloatArray:
    """x at every sample of u."""
    found = np.zeros(len(u))
    for t, force in enumerate(u):
        found[t] = state[0]
        state = step(k, d, state, force)
    return np.asarray(found, np.float64)


def records(count: int, rows: int, seed: int, noise: float = NOISE) -> dict[str, FloatArray]:
    """`count` records one after the other."""
    random = np.random.default_rng(seed)
    u = random.normal(size=(count, rows))
    starts = random.normal(size=(count, 2)) * [1.0, 2.0]
    x = np.array([positions(5.0, 0.2, s, f) for s, f in zip(starts, u, strict=True)])
    return {"u": u.ravel(), "q": (x + noise * random.normal(size=x.shape)).ravel()}


def best_start(k: float, d: float, u: FloatArray, q: FloatArray) -> FloatArray:
    """(x, v) at the first sample by linear least squares, as the oscillator is linear in them."""
    nothing = positions(k, d, np.zeros(2), u)
    columns = [positions(k, d, one, u) - nothing for one in np.eye(2)]
    there = ~np.isnan(q)
    design = np.stack(columns, axis=1)[there]
    found, *_ = np.linalg.lstsq(design, (q - nothing)[there], rcond=None)
    return np.asarray(found, np.float64)
