"""Small plants with an `mpc` section, as texts."""

from __future__ import annotations

from pathlib import Path

import msnn
from msnn.features.control.kalman_filter import KalmanFilter
from msnn.features.control.run.controller import Controller
from msnn.features.control.run.method import Solver
from msnn.model.model import Model
from msnn.model.weights.weights_file import Weights

DOUBLE_INTEGRATOR = """
msnn: 1
name: double_integrator
sample_time: 0.1 s
inputs: {u: {between: hold}}
states:
  p: {next: p + 0.1 * v, init: p.meas}
  v: {next: v + 0.1 * u, init: v.meas}
outputs: {place: p}
"""

WINDOW_AND_NO_WEIGHT = """
inputs: {u: {between: hold}}
layers: {h: {fir: {window: 6}}}
states: {x: {next: 0.9 * x + 0.02 * tanh(x) + h(u), init: 0}}
outputs: {y: x}
mpc:
  horizon: 15
  controls: [u]
  cost: {stage: 0 * x + 1e-3 * u**2, terminal: (x - 0.5)**2}
  bounds: {u: {min: -1, max: 1}, x: {min: -9, max: 9}}
"""
"""The memory of a filter, and a state that only the end of the horizon is about; without a head."""

DELAYED = """
msnn: 1
name: delayed
sample_time: 1 s
inputs: {u: {range: [-2, 2], between: hold}, d: {between: hold}, y: {}}
parameters: {a: 0.9, b: 0.5}
outputs: {y1: {expr: "a*y + 0.05*y[t-2] + b*u[t-2] + d[t-1]", predicts: "y[t+1]"}}
mpc:
  horizon: 10
  controls: [u]
  references: {r: {}}
  cost: {stage: "(y - r)**2 + 0.01*u**2", terminal: "(y - r)**2"}
  bounds: {u: {min: -2, max: 2}, y1: {max: 1.5, hard: true}}
estimator: {ekf: {measured: {y1: 0.1}, process: {y: 0.1}, initial: {y: 1}}}
"""
"""A plant that remembers past samples of its control, of a disturbance and of what is fed back."""


def load(folder: Path, text: str) -> Model:
    """The model of a text."""
    path = folder / "spec.msnn.yaml"
    path.write_text(text, encoding="utf-8")
    return msnn.load(path)


def kalman_filter(model: Model, weights: Weights | None = None) -> KalmanFilter:
    """The estimator of a model that has an `ekf`."""
    found = msnn.estimator(model, weights)
    assert isinstance(found, KalmanFilter)
    return found


def controller(folder: Path, text: str, solver: Solver | None = None) -> Controller:
    """Its controller, at the initial weights."""
    return msnn.mpc(load(folder, text), solver=solver)


def mpc(**keys: str) -> str:
    """An `mpc` section of the double integrator, with some keys of its own."""
    known = {
        "horizon": "15",
        "controls": "[u]",
        "cost": "{stage: 4 * p**2 + v**2 + 0.1 * u**2, terminal: 20 * p**2 + 5 * v**2}",
    }
    return "mpc:\n" + "".join(f"  {key}: {value}\n" for key, value in (known | keys).items())
