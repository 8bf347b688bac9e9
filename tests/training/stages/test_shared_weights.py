"""A parameter that two layers name is one weight: it is trained by the gradient of both."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.training.train import TrainingOptions, train
from tests.training.cases import compiled, dataset

MODEL = """
msnn: 1
name: shared
sample_time: 1 s
dims: {tap: 3}
inputs: {x: m, v: m}
targets: {y: N, z: N}
parameters: {W: {dims: tap, init: 0}, b: 0}
layers:
  h: {fir: {window: 3, weight: W, bias: b}}
  m: {fir: {window: 3, weight: W}}
outputs:
  first: {expr: h(x), predicts: "y"}
  second: {expr: m(v), predicts: "z"}
"""


@pytest.mark.parametrize("engine", ["native", "torch"])
def test_shared_weights_fit_the_data_of_both_layers(engine: str) -> None:
    stage = f"train:\n  - {{epochs: 60, optimizer: {{lbfgs: {{lr: 1}}}}, engine: {engine}}}\n"
    program, spec = compiled(MODEL + stage)
    random = np.random.default_rng(5)
    x, v = random.normal(size=(2, 40))
    y, z = np.zeros((2, 40))
    for t in range(2, 40):
        # with taps of their own the layers would find these two; shared ones find the mean
        y[t] = np.array([0.1, 0.2, 0.5]) @ x[t - 2 : t + 1] + 2
        z[t] = np.array([0.3, 0.2, 0.5]) @ v[t - 2 : t + 1]
    data = dataset({"x": x, "v": v, "y": y, "z": z}, train=[40])
    found = train(program, data, spec.train, TrainingOptions(runs=None)).weights
    assert set(found) == {"W", "b"}
    windows = np.array([x[t - 2 : t + 1] for t in range(2, 40)])
    others = np.array([v[t - 2 : t + 1] for t in range(2, 40)])
    ones, zeros = np.ones((38, 1)), np.zeros((38, 1))
    table = np.block([[windows, ones], [others, zeros]])
    expected, *_ = np.linalg.lstsq(table, np.concatenate((y[2:], z[2:])), rcond=None)
    # training ends at a gradient of about 1e-7 of its start
    np.testing.assert_allclose(found["W"], expected[:3], atol=1e-5)
    np.testing.assert_allclose(found["b"], expected[3], atol=1e-5)
