"""What the peer offers to join models, one test a row of the comparison."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import msnn
from tests.language.submodels.submodels import diagnostics, model_of, run

PLANT = """
    inputs: {x: V, u: V}
    parameters: {a: 0.5, b: {init: 2, unit: 1}}
    outputs: {x_next: {expr: a * x + b * u, predicts: "x[t+1]"}}
    """
LOOP = """
    use: {plant: {spec: plant.yaml}}
    inputs: {r: V}
    parameters: {gain: 0.25}
    states: {x: {unit: V, next: plant.x_next, init: 3}}
    connect: {plant.x: x, plant.u: y}
    outputs: {y: gain * (r - x)}
    """


def test_connect_closed_loop_and_state_reset(tmp_path: Path) -> None:
    program = model_of(tmp_path, LOOP, plant=PLANT).program
    reference = np.array([1.0, 2, 2, 4, 4, 1])
    for start in (0, 2):  # the state begins anew wherever a run begins
        x, expected = 3.0, list[float]()
        for r in reference[start : start + 4]:
            expected.append(0.25 * (r - x))  # connected in the same step
            x = 0.5 * x + 2 * expected[-1]  # fed back for the next
        np.testing.assert_array_equal(run(program, {"r": reference}, start, 4), expected)


def test_a_circle_of_connections_is_an_error(tmp_path: Path) -> None:
    circle = LOOP.replace("plant.u: y", "plant.u: plant.x_next")
    assert "E0702" in [found.code for found in diagnostics(tmp_path, circle, plant=PLANT)]


STAGES = """
    use: {plant: {spec: plant.yaml, freeze: none}}
    inputs: {u: V}
    targets: {x: V}
    parameters: {offset: {init: 0.5, unit: V}}
    connect: {plant.u: u}
    outputs: {y: plant.x_next + offset}
    losses: {fit: "mse(y, x[t+1])"}
    data: {source: {train: data.csv}, columns: {plant.x: x}}
    train:
      - {name: bias, epochs: 1, freeze: [plant.*], optimizer: {sgd: {lr: 0.01}}}
      - {name: plant, epochs: 1, freeze: [offset], lr: {plant.a: 0}, optimizer: {sgd: {lr: 0.01}}}
    """


def test_several_models_stages_locking_and_learning_rates(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    rows = [f"{x:.3f},{u:.3f}" for x, u in random.normal(size=(30, 2))]
    (tmp_path / "data.csv").write_text("\n".join(["x,u", *rows]) + "\n")
    model = model_of(tmp_path, STAGES, plant=PLANT)
    both = msnn.train(model, runs=None).weights
    bias_alone = STAGES[: STAGES.index("      - {name: plant")]
    first = msnn.train(model_of(tmp_path, bias_alone, plant=PLANT), runs=None).weights
    assert first["plant.a"] == 0.5
    assert first["plant.b"] == 2
    assert first["offset"] != 0.5
    assert both["offset"] == first["offset"]  # locked in the second stage
    assert both["plant.a"] == 0.5  # its learning rate is 0
    assert both["plant.b"] != 2
