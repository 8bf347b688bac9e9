"""How much of the data a page keeps: all of 100,000 samples, thinned beyond, never above 3 MB."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import msnn
from msnn.data.dataset import Dataset, FloatArray, Record
from msnn.features.report_page.records import Ports, Records, records
from msnn.simulation.simulate import Simulation, StepPlaces
from tests.data.whole_file import whole_file

SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: {}, x: {}}
outputs: {y: {expr: u + x, predicts: "x[t+1]"}}
"""
PORTS = Ports(back=0, ahead=1, signals=frozenset())


def laid_out(tmp_path: Path, lengths: Mapping[str, int]) -> Records:
    """The records of a page, of so many rows each, in files of these names; the set is theirs."""
    (tmp_path / "plant.yaml").write_text(SPEC, encoding="utf-8")
    program = msnn.load(tmp_path / "plant.yaml").program
    rows = sum(lengths.values())
    random = np.random.default_rng(0)
    series = {name: random.normal(size=rows) for name in ("u", "x")}
    files: list[Record] = []
    for name, length in lengths.items():
        start = files[-1].stop if files else 0
        files.append(whole_file(name, start, start + length))
    known = np.ones(rows, np.bool_)
    data = Dataset(
        series=series,
        records=tuple(files),
        sets=("train", "test"),
        set_of_row=np.zeros(rows, np.int8),
        continues=known,
        usable=known,
    )
    return records(program, data, [_run(record, data) for record in files], PORTS)


def _run(record: Record, data: Dataset) -> Simulation:
    steps = record.stop - record.start - 1
    x = data.series["x"][record.start + 1 : record.stop]
    time = np.linspace(0.0, 0.1 * (steps - 1), steps)
    return Simulation(
        record=record,
        first=0,
        outputs={"y": x + 0.1},
        logged={"y": x},
        inputs={"u": data.series["u"][record.start : record.start + steps]},
        places=StepPlaces(
            files=(record.file,) * steps,
            rows=np.arange(steps),
            time=None if record.file.endswith("untimed") else time,
            sets=(record.file.partition("_")[0],) * steps,
        ),
        bands={},
        starts={},
    )


def test_each_record_is_drawn_over_its_times_or_else_its_rows(tmp_path: Path):
    timed, untimed = laid_out(tmp_path, {"test_timed": 100, "test_untimed": 50}).shown
    assert (timed["timed"], timed["x"]) == (True, {"start": 0.0, "step": pytest.approx(0.1)})
    assert (untimed["timed"], untimed["x"]) == (False, {"start": 0.0, "step": 1.0})


def test_a_hundred_thousand_samples_stay_whole_and_below_3_mb(tmp_path: Path):
    found = laid_out(tmp_path, {"test_1": 100_000})
    (record,) = found.shown
    assert record["whole"]
    assert record["outputs"][0]["measured"] == {"signal": "x", "ahead": 1}
    assert record["x"] == {"start": 0.0, "step": pytest.approx(0.1)}
    assert record["outputs"][0]["rmse"] == pytest.approx(0.1)
    assert len(json.dumps(found.shown)) < 2.5e6
    assert found.left_out == []


def test_a_million_samples_are_thinned_and_told(tmp_path: Path):
    found = laid_out(tmp_path, {"test_1": 1_000_000})
    (record,) = found.shown
    assert not record["whole"]
    assert "lowest and highest of" in record["note"]
    assert len(json.dumps(found.shown)) < 2.7e6


def test_the_test_set_is_first_and_whole_and_what_has_no_room_is_told(tmp_path: Path):
    lengths = {"train_1": 100_000, "train_2": 100_000, "test_1": 20_000}
    found = laid_out(tmp_path, {**lengths, **{f"train_{3 + i}": 5_000 for i in range(40)}})
    assert found.shown[0]["name"] == "test_1 · test"
    assert found.shown[0]["whole"]
    assert not all(record["whole"] for record in found.shown)
    assert len(json.dumps(found.shown)) < 2.9e6
    missing = 43 - len(found.shown)
    assert missing > 0
    assert found.left_out[0].startswith(f"{missing} more records are not drawn")


@pytest.mark.parametrize("level", [0.0, 1e6])
def test_errors_far_smaller_than_the_level_are_drawn_as_they_are(tmp_path: Path, level: float):
    """In single precision 10⁶ Pa have steps of 0.06 Pa, and seconds since 1970 steps of 128 s."""
    x = level + np.linspace(-1.0, 1.0, 200)
    errors = 0.01 * np.sin(np.arange(199.0))
    time = 1.7e9 + np.cumsum(1 + 0.3 * np.sin(np.arange(199) / 40))
    record = whole_file("test_1", 0, 200)
    data = Dataset(
        series={"x": x, "u": np.zeros(200)},
        records=(record,),
        sets=("test",),
        set_of_row=np.zeros(200, np.int8),
        continues=np.ones(200, np.bool_),
        usable=np.ones(200, np.bool_),
    )
    run = _run(record, data)
    run = replace(run, outputs={"y": x[1:] + errors}, places=replace(run.places, time=time))
    (tmp_path / "plant.yaml").write_text(SPEC, encoding="utf-8")
    program = msnn.load(tmp_path / "plant.yaml").program
    (shown,) = records(program, data, [run], PORTS).shown
    np.testing.assert_allclose(_read(shown["x"]), time, atol=1e-4, rtol=0)
    output = shown["outputs"][0]
    measured = _read(shown["signals"]["x"])[1:]
    drawn = _read(output["error"]) if "error" in output else _read(output["simulated"]) - measured
    np.testing.assert_allclose(drawn, errors, atol=0.01 * output["rmse"], rtol=0)


def _read(packed: Mapping[str, Any]) -> FloatArray:
    """As `numbers` of plot.js."""
    single = np.frombuffer(base64.b64decode(packed["f32"]), "<f4")
    return single.astype(np.float64) + packed.get("base", 0.0)
