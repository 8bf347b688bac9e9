"""Identifies a system with jax-sysid: its L-BFGS over the whole record, in float64."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from jax_sysid.models import Model  # noqa: E402
from systems import SYSTEMS, beginning, first_values, processor_seconds, step  # noqa: E402

system = SYSTEMS[sys.argv[1]]
data = np.load(sys.argv[2])
first = first_values(system)


def following(x, u, params):
    values = [params[0][i] * first[i] for i in range(len(first))]
    states = [x[i] for i in range(system.states)]
    return jnp.stack(step(system, jnp, states, u[0], values, system.sample_time))


def measured(x, u, params):
    return x[system.output : system.output + 1]


def simulated(model, name):
    found, _ = model.predict(data[f"{name}_x0"], data[f"{name}_u"][:, None])
    return np.asarray(found)[:, 0]


seconds, computed = [], []
for fit in range(2):
    began, before = beginning(fit)
    model = Model(system.states, 1, 1, state_fcn=following, output_fcn=measured)
    model.init(params=[np.ones(len(first))], x0=data["train_x0"])
    model.loss(rho_x0=0.0, rho_th=0.0, train_x0=False)
    model.optimization(adam_epochs=0, lbfgs_epochs=1000, iprint=-1)
    model.fit(data["train_y"][:, None], data["train_u"][:, None])
    seconds.append(time.perf_counter() - began)
    computed.append(processor_seconds() - before)
error = simulated(model, "train") - data["train_y"]
clean = simulated(model, "test") - data["test_clean"]
print(
    json.dumps(
        {
            "seconds": seconds,
            "computed": computed,
            "loss": float(np.mean(error**2)),
            "test": float(np.std(clean)),
            "parameters": (np.asarray(model.params[0]) * first).tolist(),
        }
    )
)
