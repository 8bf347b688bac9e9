"""The key of a training changes with all that decides its result, and with nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn.data.dataset import Dataset
from msnn.model.model_data import measured
from msnn.training import training_result
from msnn.training.training_result import begun

SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: {}, x: {}}
parameters: {a: {init: 0.5}}
outputs: {y: {expr: a * x + u, predicts: "x[t+1]"}}
data: {source: {train: a.csv, val: b.csv}}
train: [{epochs: 1}]
"""


@pytest.fixture
def model(tmp_path: Path) -> msnn.Model:
    rng = np.random.default_rng(0)
    for name in ("a", "b"):
        rows = np.column_stack([0.1 * np.arange(20), rng.normal(size=(20, 2))])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="time,u,x", comments="")
    path = tmp_path / "plant.msnn.yaml"
    path.write_text(SPEC, encoding="utf-8")
    return msnn.load(path)


@pytest.fixture
def data(model: msnn.Model) -> Dataset:
    return measured(model, None, None, "a comparison")


def _changed(data: Dataset, what: str) -> Dataset:
    """The same with one row otherwise."""
    if what == "series":
        return replace(data, series={**data.series, "u": data.series["u"] + np.eye(40)[7]})
    values = getattr(data, what).copy()
    values[7] = 1 - values[7] if what == "set_of_row" else not values[7]
    return replace(data, **{what: values})


@pytest.mark.parametrize("what", ["series", "set_of_row", "continues", "usable"])
def test_other_rows_sets_or_gaps_are_another_training(
    model: msnn.Model, data: Dataset, what: str
) -> None:
    assert begun(model, data).key == begun(model, replace(data)).key
    assert begun(model, _changed(data, what)).key != begun(model, data).key


def test_seed_fold_and_what_is_held_out_are_told_apart(model: msnn.Model, data: Dataset) -> None:
    lines = [
        begun(model, data, held_out="val"),
        begun(model, data, held_out="train"),
        begun(model, data, held_out="val", seed=1),
        begun(model, data, held_out="val", fold=1),
        begun(model, data, held_out="val", fold=2),
    ]
    assert len({line.key for line in lines}) == len(lines)


def test_another_version_trains_anew(
    model: msnn.Model, data: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = begun(model, data).key
    monkeypatch.setattr(training_result, "__version__", "another")
    assert begun(model, data).key != before
