"""JAX: jit with lax.scan over the steps of a rollout and over batches, an epoch in one call."""

from __future__ import annotations

import json
import os
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
os.environ["JAX_PLATFORMS"] = "cpu"

import jax
import jax.numpy as jnp
import numpy as np
from serve import Contender, clock, serve

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8


class JaxScan(Contender):
    """One workload in JAX; the models are written by hand from the formulas of the specs."""

    def __init__(self, settings: dict[str, Any]) -> None:
        self._settings = settings
        self._log = {n: jnp.asarray(v, jnp.float32) for n, v in np.load(settings["data"]).items()}
        self._random = np.random.default_rng(0)
        vehicle = settings["name"] == "vehicle"
        self._loss = partial(
            _vehicle_loss if vehicle else _mass_loss, self._log, settings["horizon"]
        )
        self._epoch = jax.jit(self._run, donate_argnums=0)
        self.reset()
        started = time.perf_counter()
        self.epochs(1, fixed=True)
        self.build_seconds = time.perf_counter() - started
        self.reset()

    def reset(self) -> None:
        vehicle = self._settings["name"] == "vehicle"
        shapes = (
            {"h_v": (30,), "h_brake": (30,), "pedal": (5, 30), "c0": (), "c1": ()}
            if vehicle
            else {"h_x": (20,), "h_F": (20,)}
        )

        def zeros() -> dict[str, jax.Array]:
            return {name: jnp.zeros(shape, jnp.float32) for name, shape in shapes.items()}

        self._state = (zeros(), zeros(), zeros(), jnp.zeros((), jnp.float32))

    def _run(self, state: Any, batches: jax.Array) -> Any:
        """Trains by Adam over the batches; each row of `batches` has the start rows of one
        batch.
        """
        lr = self._settings["lr"]

        def update(carry: Any, starts: jax.Array) -> Any:
            weights, first, second, count = carry
            loss, slope = jax.value_and_grad(self._loss)(weights, starts)
            count = count + 1
            first = jax.tree.map(lambda m, g: BETA1 * m + (1 - BETA1) * g, first, slope)
            second = jax.tree.map(lambda v, g: BETA2 * v + (1 - BETA2) * g * g, second, slope)
            c1, c2 = 1 - BETA1**count, jnp.sqrt(1 - BETA2**count)
            weights = jax.tree.map(
                lambda w, m, v: w - lr / c1 * m / (jnp.sqrt(v) / c2 + EPSILON),
                weights, first, second,
            )  # fmt: skip
            return (weights, first, second, count), loss

        return jax.lax.scan(update, state, batches)

    def epochs(self, count: int, fixed: bool) -> tuple[float, list[float]]:
        settings, losses = self._settings, []
        size, starts = settings["batch"], settings["starts"]
        started = clock()
        for _ in range(count):
            order = np.arange(starts) if fixed else self._random.permutation(starts)
            whole = starts - starts % size
            rows = order[:whole].reshape(-1, size).astype(np.int32) + settings["first"]
            self._state, found = self._epoch(self._state, rows)
            losses.append(float(found.mean()))
        return clock() - started, losses


def _windows(series: jax.Array, starts: jax.Array, first: int, count: int) -> jax.Array:
    """The samples from `first` after each start row: (count, batch)."""
    return series[(starts + first) + jnp.arange(count)[:, None]]


def _mass_loss(log: Any, horizon: int, weights: Any, starts: jax.Array) -> jax.Array:
    force = _windows(log["F"], starts, -19, horizon + 19)
    target = _windows(log["x"], starts, 1, horizon)
    driven = _filtered(weights["h_F"], force, horizon)

    def step(past: jax.Array, given: Any) -> Any:
        drive, wanted = given
        new = past[-1] + weights["h_x"] @ past + drive
        return jnp.concatenate([past[1:], new[None]]), (new - wanted) ** 2

    past = _windows(log["x"], starts, -19, 20)
    return jax.lax.scan(step, past, (driven, target))[1].mean()


def _vehicle_loss(log: Any, horizon: int, weights: Any, starts: jax.Array) -> jax.Array:
    pedal = _windows(log["u"], starts, -29, horizon + 29)
    brake = _windows(log["brake"], starts, -29, horizon + 29)
    target = _windows(log["v"], starts, 1, horizon)
    local = jax.vmap(lambda taps: _filtered(taps, pedal, horizon), out_axes=1)(weights["pedal"])
    braked = _filtered(weights["h_brake"], brake, horizon)
    centers = jnp.arange(5, dtype=jnp.float32)[:, None]

    def step(past: jax.Array, given: Any) -> Any:
        models, slowed, wanted = given
        now = past[-1]
        place = jnp.clip(now / 10.0, 0.0, 4.0)
        sets = jnp.maximum(1.0 - jnp.abs(place - centers), 0.0)
        new = now + weights["h_v"] @ past + (sets * models).sum(0) + slowed
        new = new + weights["c0"] + weights["c1"] * now * now
        return jnp.concatenate([past[1:], new[None]]), (new - wanted) ** 2

    past = _windows(log["v"], starts, -29, 30)
    return jax.lax.scan(step, past, (local, braked, target))[1].mean()


def _filtered(taps: jax.Array, samples: jax.Array, horizon: int) -> jax.Array:
    """The output of a filter whose inputs are known for the whole horizon, computed before the
    steps.
    """
    rows = jnp.arange(horizon)[:, None] + jnp.arange(taps.shape[0])
    return jnp.einsum("k,tkb->tb", taps, samples[rows])


if __name__ == "__main__":
    serve(lambda text: JaxScan(json.loads(text)))
