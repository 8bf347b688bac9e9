"""Trials share what is read where it is alike, and nowhere else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.data.dataset import Dataset
from msnn.features.comparison.readings import Readings
from msnn.features.comparison.variants import Variant

SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: {unit: m}, x: {}}
constants: {u0: 1 m}
parameters: {a: {init: 0.5}}
outputs: {y: {expr: a * x + u / u0, predicts: "x[t+1]"}}
data: {source: {all: "one_*.csv"}, split: {by: kfold, k: 2}}
train: [{epochs: 1}]
"""


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    for name in (f"{kind}_{number}.csv" for kind in ("one", "other") for number in range(4)):
        rows = np.column_stack([0.1 * np.arange(20), rng.normal(size=(20, 2))])
        np.savetxt(tmp_path / name, rows, delimiter=",", header="time,u [m],x", comments="")
    path = tmp_path / "plant.msnn.yaml"
    path.write_text(SPEC, encoding="utf-8")
    return path


def read(readings: Readings, spec: Path, *settings: str, fold: int | None = None) -> Dataset:
    return readings.data(Variant(spec=spec, label="", settings=settings), fold)


@pytest.mark.parametrize(
    "setting",
    [
        "data.source={all: other_*.csv}",
        "data.split={by: kfold, k: 4}",
        "data.columns={x: time}",
        "inputs.u.unit=mm",
    ],
)
def test_a_setting_of_the_data_is_read_anew(spec: Path, setting: str) -> None:
    readings = Readings(None, None)
    one, other = read(readings, spec, fold=1), read(readings, spec, setting, fold=1)
    assert not (
        all(np.array_equal(one.series[name], other.series[name]) for name in one.series)
        and np.array_equal(one.set_of_row, other.set_of_row)
    )


@pytest.mark.parametrize("setting", ["parameters.a.init=0.7", "train.0.epochs=2"])
def test_a_setting_of_the_training_is_not(spec: Path, setting: str) -> None:
    readings = Readings(None, None)
    assert read(readings, spec, setting) is read(readings, spec)


def test_folds_share_their_series(spec: Path) -> None:
    readings = Readings(None, None)
    one, other = read(readings, spec, fold=1), read(readings, spec, fold=2)
    assert one.series is other.series
    assert not np.array_equal(one.set_of_row, other.set_of_row)


def test_folds_whose_series_differ_share_none(spec: Path) -> None:
    """As where a file was written anew between two folds."""
    readings = Readings(None, None)
    one = read(readings, spec, fold=1)
    (spec.parent / "one_0.csv").write_bytes((spec.parent / "other_0.csv").read_bytes())
    other = read(readings, spec, fold=2)
    np.testing.assert_array_equal(
        other.series["u"], read(Readings(None, None), spec, fold=2).series["u"]
    )
    assert not np.array_equal(one.series["u"], other.series["u"])
