"""Data on disk: the same bits as in memory, row groups as records, and what is refused."""

from __future__ import annotations

import gc
import time
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest

import msnn
from backends.files.disk_arrays import PAUSE, ArrayFile, DiskArray, laid_out
from msnn.data.dataset import Dataset
from msnn.model.model_data import measured
from msnn.training.records.run_record import data_hash
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.data.whole_file import whole_file

SPEC = """
msnn: 1
name: fleet
sample_time: 0.1 s
inputs: {{u: {{}}, x: {{}}}}
layers: {{h: {{fir: {{window: 3}}}}, g: {{fir: {{window: 2}}}}}}
outputs: {{y: {{expr: "h(x) + g(u)", predicts: "x[t+1]"}}}}
data:
  source: {{train: train{more_of_train}, val: val}}
  time: time
  records: {records}
  keep: {keep}{more}
train: [{{epochs: 3, batch: 64, rollout: {{horizon: 4}}{stage}}},
  {{epochs: 2, rollout: {{horizon: 4, stride: 4}}, optimizer: levenberg_marquardt}}]
validate: [{{of: y, metric: rmse}}]
"""


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """Two vehicles, three row groups each, and one file to validate on."""
    generator = np.random.default_rng(3)
    for place in ("train/vehicle=7/a", "train/vehicle=8/b", "val/c"):
        path = tmp_path / f"{place}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        rows = 300
        u = generator.normal(size=rows)
        x = np.convolve(u, [0.0, 0.5, 0.2])[:rows]
        columns: dict[str, Any] = {"time": 0.1 * np.arange(rows), "u": u, "x": x, "spare": u}
        parquet.write_table(arrow.table(columns), path, row_group_size=100)
    return tmp_path


def spec(
    folder: Path,
    keep: str,
    records: str = "row_group",
    more: str = "",
    stage: str = "",
    more_of_train: str = "",
) -> msnn.Model:
    path = folder / f"{keep}.yaml"
    text = SPEC.format(
        keep=keep, records=records, more=more, stage=stage, more_of_train=more_of_train
    )
    path.write_text(text)
    return msnn.load(path)


def test_data_on_disk_are_those_in_memory(fleet: Path) -> None:
    here, there = (
        measured(spec(fleet, keep), None, None, "training") for keep in ("memory", "disk")
    )
    assert there.is_on_disk
    assert not here.is_on_disk
    assert data_hash(here) == data_hash(there)
    assert [record.file for record in there.records] == [record.file for record in here.records]
    for ours, one in zip(there.records, here.records, strict=True):
        assert ours.place(ours.start + 5) == one.place(one.start + 5)
        told, known = (each.pieces[0].times(each.start, each.stop, None) for each in (ours, one))
        np.testing.assert_array_equal(np.asarray(told), np.asarray(known))
    np.testing.assert_array_equal(there.episodes("train"), here.episodes("train"))


def test_a_row_group_is_a_record_and_a_folder_is_a_column(fleet: Path) -> None:
    found = measured(spec(fleet, "disk"), None, None, "training")
    assert len(found.records) == 9
    assert found.records[4].file == "train/vehicle=8/b.parquet, row group 1"
    whole = measured(spec(fleet, "disk", "file"), None, None, "training")
    assert [record.stop - record.start for record in whole.records] == [300, 300, 300]
    for name, series in whole.series.items():  # groups follow each other as they do in the file
        np.testing.assert_array_equal(found.series[name], series)
    begins = [record.pieces[0].times(record.start, record.stop, None) for record in found.records]
    assert [float(times[0]) for times in begins if times is not None] == [0.0, 10.0, 20.0] * 3
    path = fleet / "vehicle.yaml"
    text = SPEC.format(keep="disk", records="row_group", more="", stage="", more_of_train="")
    path.write_text(
        text.replace("source:", "columns: {u: vehicle}\n  source:").replace(", val: val", "")
    )
    series = measured(msnn.load(path), None, None, "training").series["u"]
    np.testing.assert_array_equal(series, np.repeat([7.0, 8.0], 300))


@pytest.mark.parametrize("keep", ["memory", "disk"])
def test_row_groups_outside_of_from_and_to_are_left_out(fleet: Path, keep: str) -> None:
    model = spec(fleet, keep, more="\n  from: 10.05 s\n  to: 19.95 s")
    found = measured(model, None, None, "training")
    assert [record.file for record in found.records] == [
        f"{file}.parquet, row group 1"
        for file in ("train/vehicle=7/a", "train/vehicle=8/b", "val/c")
    ]
    with pytest.raises(SpecError) as caught:
        measured(spec(fleet, keep, more="\n  from: 99 s"), None, None, "training")
    assert {found.code for found in caught.value.diagnostics} == {"E0818"}


@pytest.mark.parametrize("records", ["file", "row_group"])
@pytest.mark.parametrize("bound", ["from: 4 s", "to: 4 s"])
def test_bounds_in_time_pick_nothing_of_a_clock_that_was_set_back(
    fleet: Path, bound: str, records: str
) -> None:
    """They took rows that do not lie between them."""
    rows = np.arange(300)
    time = 0.1 * np.where(rows >= 50, rows - 50, rows)
    columns: dict[str, Any] = {"time": time, "u": rows % 7.0, "x": rows % 5.0}
    path = fleet / "train/vehicle=7/a.parquet"
    parquet.write_table(arrow.table(columns), path, row_group_size=100)
    model = spec(fleet, "memory", records, more=f"\n  resample: none\n  {bound}")
    with pytest.raises(SpecError) as caught:
        measured(model, None, None, "training")
    (found,) = caught.value.diagnostics
    assert found.code == "E0813"
    assert "row 50 of" in found.message


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_trainings_on_disk_have_the_bits_of_those_in_memory(fleet: Path, dtype: str) -> None:
    require_tool("gcc", install="apt install gcc")
    stage = f", dtype: {dtype}"
    here, there = (
        msnn.train(spec(fleet, keep, stage=stage), runs=None) for keep in ("memory", "disk")
    )
    for name, value in here.weights.items():
        np.testing.assert_array_equal(there.weights[name], value)
    assert here.stages[-1].best_value == there.stages[-1].best_value


@pytest.mark.parametrize(
    ("more", "stage", "word"),
    [("\n  join: true", "", "join"), ("", ", engine: torch", "torch")],
)
def test_what_needs_all_rows_in_memory_is_refused(
    fleet: Path, more: str, stage: str, word: str
) -> None:
    with pytest.raises(SpecError) as caught:
        msnn.train(spec(fleet, "disk", more=more, stage=stage), runs=None)
    (found,) = caught.value.diagnostics
    assert found.code == "E0869"
    assert word in found.message


def test_results_of_too_many_rows_are_refused(fleet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = spec(fleet, "disk")
    assert msnn.validate(model).measurements
    monkeypatch.setattr("msnn.model.model_data.MOST_ROWS", 100)
    with pytest.raises(SpecError) as caught:
        msnn.validate(model)
    assert [found.code for found in caught.value.diagnostics] == ["E0869"]


def test_faulty_files_are_said_as_in_memory(fleet: Path) -> None:
    (fleet / "train/vehicle=8/broken.parquet").write_text("no table")
    said: list[str] = []
    for keep in ("memory", "disk"):
        with pytest.raises(SpecError) as caught:
            measured(spec(fleet, keep), None, None, "training")
        said += [found.message for found in caught.value.diagnostics]
    assert len(set(said)) == 1
    assert "broken.parquet" in said[0]


def test_records_without_inputs_are_dropped_on_disk_too(fleet: Path) -> None:
    path = fleet / "train/vehicle=7/a.parquet"
    table = parquet.read_table(path)
    u = table.column("u").to_numpy().copy()
    u[150] = np.nan
    parquet.write_table(table.set_column(1, "u", arrow.array(u)), path, row_group_size=100)
    more = "\n  nan: drop"
    here, there = (
        measured(spec(fleet, keep, more=more), None, None, "training")
        for keep in ("memory", "disk")
    )
    assert len(there.records) == 8
    assert data_hash(here) == data_hash(there)


def test_episodes_do_not_depend_on_how_many_rows_are_looked_at_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    generator = np.random.default_rng(0)
    for _ in range(50):
        rows = int(generator.integers(1, 30))
        data = Dataset(
            series={},
            records=(whole_file("a", 0, rows),),
            sets=("train",),
            set_of_row=generator.integers(-1, 1, rows).astype(np.int8),
            continues=generator.random(rows) < 0.7,
            usable=generator.random(rows) < 0.8,
        )
        right = data.episodes("train")
        with monkeypatch.context() as patched:
            patched.setattr("msnn.data.dataset.AT_ONCE", 3)
            np.testing.assert_array_equal(data.episodes("train"), right)
        wanted = data.in_set("train") & data.usable
        inside = np.concatenate([np.arange(a, b) for a, b in right] or [np.zeros(0, int)])
        np.testing.assert_array_equal(np.flatnonzero(wanted), inside)
        for start, stop in right:
            assert data.continues[start + 1 : stop].all()


def test_what_nobody_reads_any_more_is_closed(tmp_path: Path) -> None:
    file = ArrayFile(tmp_path)
    file.append(np.ones(10))
    found = file.array()
    assert isinstance(found, DiskArray)
    assert found.pages is not None
    pages = weakref.ref(found.pages)
    time.sleep(3 * PAUSE)
    del found
    time.sleep(3 * PAUSE)
    gc.collect()
    assert pages() is None


def test_an_array_on_disk_has_one_copy_of_each_type(tmp_path: Path) -> None:
    file = ArrayFile(tmp_path)
    values = np.random.default_rng(0).normal(size=(1000, 3))
    for part in np.split(values, 4):
        file.append(part)
    found = file.array()
    assert isinstance(found, DiskArray)
    assert list(tmp_path.iterdir()) == []  # nothing is left of a process that is killed
    np.testing.assert_array_equal(found, values)
    copy = laid_out(found, np.dtype(np.float32))
    np.testing.assert_array_equal(copy, values.astype(np.float32))
    assert laid_out(found, np.dtype(np.float32)) is copy
    assert laid_out(found, np.dtype(np.float64)) is found
    time.sleep(3 * PAUSE)
    np.testing.assert_array_equal(found, values)  # pages that were given back are read again


@pytest.mark.parametrize("records", ["file", "row_group"])
def test_dates_of_row_groups_have_the_zone_of_their_column(fleet: Path, records: str) -> None:
    for path in fleet.rglob("*.parquet"):
        table = parquet.read_table(path)
        moments = np.datetime64("2026-11-22T10:00") + 100 * np.arange(300).astype("timedelta64[ms]")
        dates = arrow.array(moments, arrow.timestamp("ms", "Europe/Berlin"))
        parquet.write_table(table.set_column(0, "time", dates), path, row_group_size=100)
    more = "\n  from: "
    noon = spec(fleet, "disk", records, more=f"{more}2026-11-22T09:00Z")
    assert sum(measured(noon, None, None, "training").usable) == 900
    with pytest.raises(SpecError) as caught:
        measured(
            spec(fleet, "disk", records, more=f"{more}2026-11-22 09:00"), None, None, "training"
        )
    assert {found.code for found in caught.value.diagnostics} == {"E0979"}


@pytest.mark.parametrize("drop", ["drop", "split"])
def test_rows_of_models_without_time_stay_on_disk_as_in_memory(tmp_path: Path, drop: str) -> None:
    u = np.arange(50.0)
    u[20] = np.nan
    parquet.write_table(arrow.table({"u": u, "x": 2 * u}), tmp_path / "a.parquet")
    path = tmp_path / "static.yaml"
    found: list[Dataset] = []
    for keep in ("memory", "disk"):
        path.write_text(
            "msnn: 1\nname: static\ninputs: {u: {}, x: {}}\nparameters: {k: {init: 1}}\n"
            "outputs: {y: {expr: k * u, predicts: x}}\n"
            f"data: {{source: {{train: a.parquet}}, nan: {drop}, keep: {keep}}}\n"
            "train: [{epochs: 1}]\n"
        )
        found.append(measured(msnn.load(path), None, None, "training"))
    here, there = found
    assert len(here.usable) == 50
    assert data_hash(here) == data_hash(there)


def test_drops_are_no_faults_of_data_on_disk(fleet: Path) -> None:
    path = fleet / "train/vehicle=7/a.parquet"
    table = parquet.read_table(path)
    u = np.full(300, np.nan)
    parquet.write_table(table.set_column(1, "u", arrow.array(u)), path, row_group_size=100)
    (fleet / "train/vehicle=8/broken.parquet").write_text("no table")
    for keep in ("memory", "disk"):
        with pytest.raises(SpecError) as caught:
            measured(spec(fleet, keep, more="\n  nan: drop"), None, None, "training")
        assert [found.code for found in caught.value.diagnostics] == ["E0802"]
