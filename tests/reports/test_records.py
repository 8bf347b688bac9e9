"""How much of the data a page keeps: all of 100,000 samples, thinned beyond, never above 3 MB."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn.data.dataset import Dataset, Record, whole_file
from msnn.reports.page.records import Ports, Records, records
from msnn.simulation.simulate import Simulation, StepPlaces

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
    return Simulation(
        record=record,
        first=0,
        outputs={"y": x + 0.1},
        logged={"y": x},
        inputs={"u": data.series["u"][record.start : record.start + steps]},
        places=StepPlaces(
            files=(record.file,) * steps,
            rows=np.arange(steps),
            time=np.linspace(0.0, 0.1 * (steps - 1), steps),
            sets=(record.file.partition("_")[0],) * steps,
        ),
        bands={},
    )


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
