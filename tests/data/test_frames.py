"""Frames and arrays of a session train and validate like the files that hold the same rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest

import msnn
from msnn.data.formats.arrays.array_columns import dates_of
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.expressions.moments import Moment

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


@pytest.mark.parametrize("kind", [float, int])
def test_what_a_mask_leaves_out_is_missing(model: msnn.Model, kind: type) -> None:
    force = np.ma.masked_array(np.arange(60).astype(kind), mask=np.arange(60) == 7)
    with pytest.raises(SpecError, match="column `force` has `NaN` in row 7"):
        msnn.train(model, {"position": np.zeros(60), "force": force}, runs=None)


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


DATED = """
msnn: 1
name: plant
sample_time: 0.5 s
inputs: {F: {unit: N}}
outputs: {y: {expr: 1 * F, unit: N}}
data: {source: {train: none.csv}, time: time, join: true}
"""
NAIVE = pd.date_range("2026-11-22 17:00", periods=4, freq="500ms")
ZONED = NAIVE.tz_localize("Europe/Berlin")


def _parts(times: Any, make: Any) -> list[Any]:
    return [make({"time": t, "F": [1.0, 2.0]}) for t in (times[:2], times[2:])]


DATES: dict[str, list[Any]] = {
    "pandas": _parts(NAIVE, pd.DataFrame),
    "pandas with a zone": _parts(ZONED, pd.DataFrame),
    "texts": _parts([str(time) for time in ZONED], pd.DataFrame),
    "polars": _parts(NAIVE.to_pydatetime().tolist(), pl.DataFrame),
    "polars with a zone": _parts(ZONED.tz_convert("UTC").to_pydatetime().tolist(), pl.DataFrame),
    "arrays": _parts(NAIVE.to_numpy(), dict),
    "datetimes": _parts(np.array(ZONED.to_pydatetime()), dict),
}


def _runs(folder: Path, frames: Any, spec: str = DATED) -> Any:
    (folder / "plant.yaml").write_text(spec)
    return msnn.simulate(msnn.load(folder / "plant.yaml"), data=frames)


@pytest.mark.parametrize("kind", DATES)
def test_frames_with_dates_are_joined(tmp_path: Path, kind: str) -> None:
    (run,) = _runs(tmp_path, DATES[kind])
    assert run.steps == 4


@pytest.mark.parametrize("other", ["pandas with a zone", "texts", "polars with a zone"])
def test_frames_of_another_clock_are_not_joined(tmp_path: Path, other: str) -> None:
    mixed = [DATES["pandas"][0], DATES[other][1]]
    assert [run.steps for run in _runs(tmp_path, mixed)] == [2, 2]


@pytest.mark.parametrize("kind", ["pandas with a zone", "polars with a zone", "pandas"])
def test_parquet_files_with_dates_are_joined(tmp_path: Path, kind: str) -> None:
    for name, frame in zip("ab", DATES[kind], strict=True):
        write = frame.write_parquet if isinstance(frame, pl.DataFrame) else frame.to_parquet
        write(tmp_path / f"{name}.parquet")
    (run,) = _runs(tmp_path, None, DATED.replace("none.csv", "[a.parquet, b.parquet]"))
    assert run.steps == 4


@pytest.mark.parametrize(
    ("times", "code"),
    [
        ([NAIVE[0], pd.NaT], "E0809"),
        (["2026-11-22 17:00", "later"], "E0989"),
        (["2026-11-22 17:00", "2026-11-22 17:00:00.5Z"], "E0990"),
        (["2026-11-22 17:00", None], "E0809"),
        (["now", "later"], "E0840"),
        (np.array(["2026-11-22", "9999-12-31"], "M8[s]"), "E1319"),
        (np.array(["0001-01-01", "2026-11-22"], "M8[us]"), "E1319"),
        (np.array(["2116-02-20", "2116-02-21"], "M8[s]"), "E1319"),
        (np.array(["1823-11-11", "1823-11-13"], "M8[ns]"), "E1319"),
    ],
)
def test_what_is_wrong_with_dates_in_frames(tmp_path: Path, times: Any, code: str) -> None:
    with pytest.raises(SpecError) as caught:
        _runs(tmp_path, pd.DataFrame({"time": times, "F": [1.0, 2.0]}))
    assert [found.code for found in caught.value.diagnostics] == [code]


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns", "500ms", "ps"])
def test_dates_of_numpy_are_seconds_whatever_their_ticks(unit: str) -> None:
    times = np.array(["1969-12-31T23:59:59", "NaT", "1970-01-03T00:00:01"], f"M8[{unit}]")
    found = dates_of(times, "a.npz", "time", is_utc=True)
    assert found.seconds.tolist() == pytest.approx([0, np.nan, 2 * 86400 + 2], abs=0, nan_ok=True)
    assert found.begins == Moment(-(10**9), has_zone=True)


def test_days_of_numpy_are_seconds() -> None:
    times = np.array(["1969-12-31", "NaT", "2100-01-01"], "M8[D]")
    found = dates_of(times, "a.npz", "time", is_utc=False)
    assert found.seconds.tolist() == pytest.approx([0, np.nan, 47483 * 86400], abs=0, nan_ok=True)


@pytest.mark.parametrize("make", [pd.DataFrame, pl.DataFrame, dict])
def test_units_in_the_names_of_columns_convert(tmp_path: Path, make: Any) -> None:
    (run,) = _runs(tmp_path, make({"time [ms]": [0.0, 500.0], "F [kN]": [0.001, 0.002]}))
    assert run.outputs["y"].tolist() == [1.0, 2.0]


def test_two_columns_that_differ_in_their_unit_are_asked(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="two columns `F`"):
        _runs(tmp_path, pd.DataFrame({"time": [0, 0.5], "F [kN]": [0, 1], "F [N]": [0, 1]}))


@pytest.mark.parametrize("data", [{}, {"u": [1.0, 2.0, 3.0]}])
def test_data_of_which_a_model_reads_no_column_give_no_steps(data: dict[str, list[float]]) -> None:
    spec = "msnn: 1\nname: free\nsample_time: 1 s\ninputs: {u: m}\n"
    model = msnn.load(spec + "states: {x: {next: 0.5 * x, init: 1}}\noutputs: {y: x}\n")
    with pytest.raises(msnn.SpecError, match="E1326"):
        msnn.simulate(model, data)
