"""L-BFGS finds what is known to be least, by the steps of torch where one may compare them."""

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


def test_what_is_held_takes_no_part(engine: str) -> None:
    """Neither its weight decay nor its prior: they would promise a fall that never comes."""
    held = LINEAR.replace("init: 0}", "init: 0}, c: {init: 5, prior: {mean: 0, std: 0.1}}")
    held = held.replace("over=column)", "over=column) + c")
    stage = "epochs: 2, freeze: c, weight_decay: 0.3, optimizer: {lbfgs: {iterations: 40}}"
    found = run(held, f"{stage}, engine: {engine}").weights
    right = np.linalg.solve(2 / ROWS * U.T @ U + 0.3 * np.eye(3), 2 / ROWS * U.T @ (Y - 5))
    np.testing.assert_allclose(found["w"], right, rtol=1e-6)
    assert found["c"] == 5


MEMORY = """
inputs: {u: 1}
targets: {y: m}
parameters:
  a: {init: 0.3, min: 0, max: 1}
  b: {init: 0.1, unit: m, scale: 0.5, prior: {mean: 40 cm, std: 5 cm}}
  c: {init: 2, min: 0.1, prior: {mean: 1, std: 0.3}}
states: {x: {unit: m, next: "a*x + b*tanh(c*u)", init: 0}}
outputs: {z: {expr: x, predicts: y}}
"""
PLAIN = "optimizer: {lbfgs: {iterations: 8}}"


def log_with_gaps() -> tuple[FloatArray, FloatArray]:
    random = np.random.default_rng(3)
    u = random.uniform(-1, 1, ROWS)
    y = np.zeros(ROWS)
    for t in range(ROWS - 1):
        y[t + 1] = 0.8 * y[t] + 0.5 * np.tanh(u[t]) + random.normal(0, 0.02)
    y[random.choice(ROWS, 10, replace=False)] = np.nan
    return u, y


LOG = log_with_gaps()


@pytest.mark.parametrize(
    "stage",
    [
        PLAIN,
        f"{PLAIN}, weight_decay: 0.05",
        f"{PLAIN}, weight_decay: 0.05, freeze: b",
        "optimizer: {lbfgs: {iterations: 8, lr: 0.3}}",
        "optimizer: {lbfgs: {iterations: 8, lr: 30}}",
        "optimizer: {lbfgs: {iterations: 8, history: 2}}",
        # where slopes of loss, decay and priors add to 0 each is longer than that
        f"{PLAIN}, weight_decay: 0.05, clip: 0.05",
        f"{PLAIN}, clip: 0.3",
        f"{PLAIN}, losses: {{z: 0.01}}",
        f"{PLAIN}, losses: {{z: 1000}}",
    ],
)
def test_steps_with_all_that_a_stage_can_ask_for_are_those_of_torch(stage: str) -> None:
    require_tool("gcc", install="apt install gcc")
    native, torch = (
        run(MEMORY, f"epochs: 1, rollout: 15, engine: {name}, {stage}", *LOG)
        for name in ("native", "torch")
    )
    for name, value in native.weights.items():
        # a line search decides on differences of losses, so that rounding grows over iterations
        assert value == pytest.approx(torch.weights[name], rel=1e-6), name
    assert native.stages[0].best_value == pytest.approx(torch.stages[0].best_value, rel=1e-6)
