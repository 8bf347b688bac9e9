"""`msnn.torch_module` does in memory what the torch export does in files."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import msnn

SPEC = """\
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {F: N, x: m}
dims: {i: 2}
parameters:
  k: {init: 3, unit: N/m, min: 0, max: 10}
  m: {init: 2, unit: kg, learn: false}
layers: {h: {fir: {window: 4}}}
states:
  v: {unit: m/s, init: "(x[t] - x[t-1]) / dt", next: v + dt * (F - k * x) / m}
outputs:
  x_next: {expr: "x + dt * v + h(F)", unit: m, predicts: "x[t+1]"}
"""


@pytest.fixture
def exported(tmp_path: Path) -> Any:
    model = msnn.load(SPEC)
    msnn.export(model, "torch", tmp_path)
    found = importlib.util.spec_from_file_location("plant", tmp_path / "plant.py")
    assert found is not None
    assert found.loader is not None
    module: Any = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module.load()


def _tensors(given: dict[str, Any], rng: np.random.Generator) -> dict[str, torch.Tensor]:
    return {name: torch.tensor(rng.normal(size=shape)) for name, shape in given.items()}


def test_it_steps_as_the_exported_module_does(exported: Any) -> None:
    module = msnn.torch_module(msnn.load(SPEC))
    rng = np.random.default_rng(3)
    windows = _tensors({"F": (5, 3), "x": (5, 2)}, rng)
    state, other = module.initial_state(windows), exported.initial_state(windows)
    for _ in range(6):
        inputs = _tensors({"F": (5,), "x": (5,)}, rng)
        outputs, state = module(inputs, state)
        expected, other = exported(inputs, other)
        torch.testing.assert_close(outputs, expected, rtol=0.0, atol=0.0)
        torch.testing.assert_close(state, other, rtol=0.0, atol=0.0)


def test_it_learns_and_gives_its_weights_back(tmp_path: Path) -> None:
    model = msnn.load(SPEC)
    module = msnn.torch_module(model, {**msnn.initial_weights(model), "k": 4.0})
    assert module.weights()["k"] == 4.0
    optimizer = torch.optim.SGD(module.parameters(), lr=0.1)
    state = module.initial_state(_tensors({"F": (1, 3), "x": (1, 2)}, np.random.default_rng(0)))
    inputs = {name: torch.ones(1, dtype=torch.float64) for name in ("F", "x")}
    _, state = module(inputs, state)
    module(inputs, state)[0]["x_next"].sum().backward()
    optimizer.step()
    assert module.weights()["k"] != pytest.approx(4.0, rel=1e-9)
    assert 0 < module.weights()["k"] < 10
    assert module.weights()["m"] == 2.0
    assert msnn.export(model, "c", tmp_path, module)
