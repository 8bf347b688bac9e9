"""Frames and arrays of a session train and validate like the files that hold the same rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest

import msnn
from spec_schema.diagnostics.diagnostic import SpecError

SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {x: {unit: m}, u: N}
parameters: {a: 0.5, b: {init: 0.1, unit: m/N}}
outputs: {x_next: {expr: a*x + b*u, predicts: "x[t+1]", unit: m}}
data:
  source: {train: data/*.csv}
  columns: {x: {column: position, unit: mm}, u: force}
train:
  - {epochs: 20, batch: 16, optimizer: {adam: {lr: 0.01}}, engine: torch, dtype: float64}
validate:
  - {of: x_next, metric: rmse}
"""


def columns(seed: int, rows: int = 60) -> dict[str, np.ndarray]:
    draw = np.random.default_rng(seed)
    force, x = draw.normal(size=rows), np.zeros(rows)
    for t in range(rows - 1):
        x[t + 1] = 0.8 * x[t] + 0.3 * force[t]
    return {"position": 1e3 * x, "force": force}


@pytest.fixture
def model(tmp_path: Path) -> msnn.Model:
    (tmp_path / "plant.yaml").write_text(SPEC)
    (tmp_path / "data").mkdir()
    pd.DataFrame(columns(0)).to_csv(tmp_path / "data" / "a.csv", index=False)
    pd.DataFrame(columns(1)).to_csv(tmp_path / "data" / "b.csv", index=False)
    return msnn.load(tmp_path / "plant.yaml")


@pytest.mark.parametrize("kind", ["arrays", "lists", "pandas", "polars"])
def test_frames_train_as_files_do(model: msnn.Model, kind: str) -> None:
    make: Any = {
        "arrays": dict,
        "lists": lambda c: {name: list(values) for name, values in c.items()},
        "pandas": pd.DataFrame,
        "polars": pl.DataFrame,
    }[kind]
    frames = [make(columns(0)), make(columns(1))]
    by_files = msnn.train(model, runs=None)
    by_frames = msnn.train(model, frames, runs=None)
    np.testing.assert_array_equal(by_frames.weights["a"], by_files.weights["a"])
    report = msnn.validate(model, by_frames.weights, frames)
    assert report.rows == msnn.validate(model, by_files.weights).rows


def test_frames_of_sets(model: msnn.Model) -> None:
    train, val = pd.DataFrame(columns(0)), pd.DataFrame(columns(1))
    result = msnn.train(model, {"train": [train], "val": val}, runs=None)
    assert set(result.weights) == {"a", "b"}


def test_a_spec_without_data_takes_frames(tmp_path: Path) -> None:
    text = SPEC[: SPEC.index("data:")] + SPEC[SPEC.index("train:\n") :]
    (tmp_path / "plant.yaml").write_text(text)
    made = columns(0)
    frame = {"x": made["position"], "u": made["force"]}
    assert msnn.train(msnn.load(tmp_path / "plant.yaml"), frame, runs=None).weights


def test_what_is_wrong_with_frames(model: msnn.Model) -> None:
    with pytest.raises(SpecError, match=r"train\[0\] has no column `force`"):
        msnn.train(model, {"position": np.ones(9)}, runs=None)
    with pytest.raises(TypeError, match="not int"):
        msnn.train(model, [3], runs=None)  # pyright: ignore[reportArgumentType]
    with pytest.raises(SpecError, match="E0841"):
        msnn.train(model, {"position": np.ones(9), "force": np.ones(8)}, runs=None)
