"""`scale: data`: parameters of any unit train together from the first step."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from msnn.data.dataset import Dataset
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset
from tests.training.oscillator import FITTED, best_start, positions, records

PLANT = """
msnn: 1
name: plant
sample_time: 1 s
inputs: {x: 1, u: 1}
parameters:
  a: {init: 0.5, SCALE}
  k: {init: 1000, SCALE}
outputs: {x_next: {expr: a * x + k * u, predicts: "x[t+1]"}}
train: [{epochs: 60, batch: 16, schedule: {cosine: {}}, STAGE}]
"""
"""x[t+1] = 0.95 x[t] + 5000 u[t], u of size 1e-4."""


def data(rows: int = 300) -> Dataset:
    random = np.random.default_rng(8)
    u, x = 1e-4 * random.normal(size=rows), np.zeros(rows)
    for t in range(rows - 1):
        x[t + 1] = 0.95 * x[t] + 5000 * u[t]
    return dataset({"x": x, "u": u}, train=[rows])


def text(scale: str, stage: str = "optimizer: {adam: {lr: 0.02}}") -> str:
    found = PLANT.replace("STAGE", stage)
    return found.replace("SCALE", scale) if scale else found.replace(", SCALE", "")


@pytest.mark.parametrize("engine", ["native", "torch"])
def test_numbers_of_0_95_and_5000_train_together(engine: str) -> None:
    require_tool("gcc", install="apt install gcc")
    stage = f"optimizer: {{adam: {{lr: 0.02}}}}, engine: {engine}"
    program, spec = compiled(text("scale: data", stage))
    result = train(program, data(), spec.train, TrainingOptions(runs=None))
    assert result.weights["a"] == pytest.approx(0.95, abs=1e-3)
    assert result.weights["k"] == pytest.approx(5000, rel=1e-3)
    program, spec = compiled(text("", stage))
    without = train(program, data(), spec.train, TrainingOptions(runs=None))
    assert without.weights["k"] == pytest.approx(1000, rel=0.02)


STEADY = """
msnn: 1
name: steady
sample_time: 1 s
inputs: {u: 1}
targets: {y: 1}
parameters: {k: {init: 1000, scale: data}}
outputs: {z: {expr: k * u, predicts: "y[t]"}}
train: [{epochs: 1, optimizer: adam, engine: torch, rollout: {horizon: 10}}]
"""


def test_rows_without_a_target_do_not_change_the_scale(tmp_path: Path) -> None:
    program, spec = compiled(STEADY)
    y = np.where(np.arange(300) % 2, 3.0, -3.0)
    found: list[dict[str, float]] = []
    for number, kept in enumerate((y, np.where(np.arange(300) % 5 < 2, y, np.nan))):
        rows = dataset({"u": np.ones(300), "y": kept}, train=[300])
        result = train(program, rows, spec.train, TrainingOptions(runs=tmp_path / str(number)))
        assert result.folder is not None
        record = json.loads((result.folder / "run.json").read_text())
        found.append(record["stages"][0]["scales"])
    # a slope of 1 everywhere: the scale is the deviation of the target, however few there are
    assert found == [pytest.approx({"k": 3.0}, rel=1e-12)] * 2


def test_the_scale_is_that_of_its_formula(tmp_path: Path) -> None:
    program, spec = compiled(text("scale: data", "optimizer: adam, engine: torch"))
    found = data()
    result = train(program, found, spec.train, TrainingOptions(runs=tmp_path))
    assert result.folder is not None
    scales = json.loads((result.folder / "run.json").read_text())["stages"][0]["scales"]
    x, u = found.series["x"], found.series["u"]
    few = np.unique(np.linspace(0, len(x) - 2, 32).round().astype(int))
    for name, factor in {"a": x, "k": u}.items():
        slope = np.sqrt(np.mean(factor[few] ** 2))
        assert scales[name] == pytest.approx(np.std(x) / slope, rel=1e-12)


def test_the_scale_is_that_along_rollouts_that_start_where_they_fit(tmp_path: Path) -> None:
    rows, over = 90, 40
    series = records(1, rows, seed=3)
    model = FITTED.replace("init: 6,", "init: 6, scale: data,")
    stage = "{epochs: 1, rollout: record, optimizer: levenberg_marquardt, engine: torch}"
    program, spec = compiled(f"{model}train: [{stage}]\n")
    found = dataset(series, train=[rows])
    result = train(program, found, spec.train, TrainingOptions(runs=tmp_path))
    assert result.folder is not None
    scales = json.loads((result.folder / "run.json").read_text())["stages"][0]["scales"]
    u, q = series["u"], series["q"]
    start = best_start(6.0, 0.3, u[:over], q[:over])
    low, high = (positions(k, 0.3, start, u)[over:] for k in (6 - 1e-4, 6 + 1e-4))
    slope = np.sqrt(np.mean(((high - low) / 2e-4) ** 2))
    assert scales["k"] == pytest.approx(np.std(q) / slope, rel=1e-6)


def test_a_parameter_without_effect_has_no_scale() -> None:
    changed = text("scale: data").replace("a * x + k * u", "a * x + 0 * a * k * u")
    program, spec = compiled(changed.replace("init: 0.5", "init: 0"))
    with pytest.raises(SpecError) as caught:
        train(program, data(), spec.train, TrainingOptions(runs=None))
    assert [d.code for d in caught.value.diagnostics] == ["E0969"]
