"""A physics-informed network: Burgers' equation u_t + u u_x = ν u_xx in the losses."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from msnn.data.dataset import FloatArray
from msnn.training.train import TrainingOptions, train
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset
from tests.training.stages.test_stages import Recorder

VISCOSITY, SPEED = 0.1, 0.5

BURGERS = """
msnn: 1
name: burgers
inputs: {x: {unit: 1}, tau: {unit: 1}}
targets: {u0: {unit: 1}}
layers: {net: {mlp: {hidden: [12, 12]}}}
equations:
  u: UNKNOWN
  u_x: grad(u, x)
  residual: grad(u, tau) + u * u_x - 0.1 * grad(u_x, x)
outputs: {y: u, r: residual}
losses:
  physics: mse(residual, 0)
  data: {expr: "mse(u, u0)", weight: 10}
"""


def wave(x: FloatArray, tau: FloatArray) -> FloatArray:
    """A travelling wave, an exact solution: c (1 − tanh(c (x − c τ) / (2 ν)))."""
    return SPEED * (1 - np.tanh(SPEED * (x - SPEED * tau) / (2 * VISCOSITY)))


def points() -> dict[str, FloatArray]:
    """Points of the strip −1 … 1, 0 … 1; u is known where it begins and at its sides only."""
    random = np.random.default_rng(4)
    x, tau = random.uniform(-1, 1, 384), random.uniform(0, 1, 384)
    tau[:64] = 0
    x[64:128] = random.choice([-1.0, 1.0], 64)
    known = np.arange(384) < 128
    order = random.permutation(384)
    u0 = np.where(known, wave(x, tau), np.nan)
    return {"x": x[order], "tau": tau[order], "u0": u0[order]}


def test_the_exact_solution_has_no_residual() -> None:
    program, _ = compiled(BURGERS.replace("UNKNOWN", "0.5 * (1 - tanh(2.5 * (x - 0.5 * tau)))"))
    log = points()
    found = Interpreter(program).step(log, np.arange(384), {}, losses=False)
    np.testing.assert_allclose(found.outputs["r"], 0, atol=1e-14)


@pytest.mark.parametrize("engine", ["native", "torch"])
def test_a_network_learns_the_solution_from_its_equation(engine: str) -> None:
    require_tool("gcc", install="apt install gcc")
    stage = f"""
train:
  - epochs: 120
    batch: 64
    optimizer: {{adam: {{lr: 0.01}}}}
    dtype: float64
    engine: {engine}
"""
    program, spec = compiled(BURGERS.replace("UNKNOWN", "net(x, tau)") + stage)
    recorder = Recorder()
    log = points()
    result = train(
        program, dataset(log, train=[384]), spec.train, TrainingOptions(runs=None), recorder
    )
    first, last = recorder.epochs[0].losses, recorder.epochs[-1].losses
    assert last["physics"] < 5e-3
    assert last["data"] < first["data"] / 50
    # inside, where no value was given, the wave is found from the equation alone
    found = Interpreter(program, result.weights).step(log, np.arange(384), {}, losses=False)
    error = found.outputs["y"] - wave(log["x"], log["tau"])
    assert np.sqrt(np.mean(error**2)) < 0.03
