"""L-BFGS finds what is known to be least; `test_engines` compares its steps with torch's."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.data.dataset import FloatArray
from msnn.training.train import TrainingOptions, train
from msnn.training.training_result import TrainingResult
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset

ROWS = 40
RANDOM = np.random.default_rng(5)
U = RANDOM.uniform(-1, 1, (ROWS, 3)) @ np.diag([1.0, 30.0, 0.1])
Y = U @ [1.5, -0.2, 8.0] + RANDOM.normal(0, 0.3, ROWS)

HEAD = "msnn: 1\nname: m\nsample_time: 0.1 s\n"
LINEAR = """
dims: {column: 3}
inputs: {u: {dims: [column]}}
targets: {y: 1}
parameters: {w: {dims: [column], init: 0}}
outputs: {z: {expr: "sum(w * u, over=column)", predicts: y}}
"""
VALLEY = """
inputs: {u: 1}
targets: {y: 1}
parameters: {a: -1.2, b: 1}
outputs:
  far: {expr: "10 * (b - a**2) + 0*u", predicts: y}
  near: {expr: "1 - a + 0*u", predicts: y}
"""
"""Rosenbrock's (1960) as the sum of two squares."""


@pytest.fixture(params=["native", "torch"])
def engine(request: pytest.FixtureRequest) -> str:
    require_tool("gcc", install="apt install gcc")
    return request.param


def run(model: str, stage: str, u: FloatArray = U, y: FloatArray = Y) -> TrainingResult:
    program, spec = compiled(f"{HEAD}{model}train:\n  - {{dtype: float64, {stage}}}\n")
    data = dataset({"u": u, "y": y}, train=[ROWS])
    return train(program, data, spec.train, TrainingOptions(runs=None))


@pytest.mark.parametrize("decay", [0.0, 0.3])
def test_linear_models_come_to_least_squares_with_weight_decay(engine: str, decay: float) -> None:
    stage = f"epochs: 1, optimizer: {{lbfgs: {{iterations: 40}}}}, weight_decay: {decay}"
    found = run(LINEAR, f"{stage}, engine: {engine}").weights["w"]
    right = np.linalg.solve(2 / ROWS * U.T @ U + decay * np.eye(3), 2 / ROWS * U.T @ Y)
    np.testing.assert_allclose(found, right, rtol=1e-6)


@pytest.mark.parametrize("history", [1, 3, 10])
def test_a_bent_valley_is_followed_to_its_end(engine: str, history: int) -> None:
    nothing = np.zeros(ROWS)
    optimizer = f"optimizer: {{lbfgs: {{iterations: 50, history: {history}}}}}"
    found = run(VALLEY, f"epochs: 2, engine: {engine}, {optimizer}", nothing, nothing).weights
    np.testing.assert_allclose([found["a"], found["b"]], 1.0, rtol=1e-6)
