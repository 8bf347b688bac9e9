"""`missing:` names numbers and texts of cells that mean: not measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest

import msnn
from spec_schema.diagnostics.diagnostic import SpecError
from tests.data.specs import load

SOURCE = "source: {train: log.csv}\ntime: time\nnan: split\n"


def missing_rows(folder: Path, keys: str, cells: list[str], **files: str) -> list[int]:
    """The rows without x, of a file whose column x has these cells."""
    rows = [f"{0.2 * row:.1f},{cell},{-row}" for row, cell in enumerate(cells)]
    texts = files or {"log.csv": "\n".join(["time,x,F", *rows]) + "\n"}
    series = load(folder, keys if "source" in keys else SOURCE + keys, texts).series
    return np.flatnonzero(np.isnan(series["x"])).tolist()


@pytest.mark.parametrize(
    ("keys", "cells", "rows"),
    [
        ("missing: -9999", ["1", "-9999", "-9999.00", "-9.999e3", "-9998"], [1, 2, 3]),
        ('missing: ["-9999"]', ["1", "-9999", "-9999.00", "-9.999e3", "-9998"], [1, 2, 3]),
        ('missing: ["-9999", "1e999", "---"]', ["1", "-9999", "---", "3"], [1, 2]),
        ("missing: [-9999, n.v.]", ["1", "N.V.", "-9999", "3"], [1, 2]),
        ('missing: ["---", "sensor fault"]', ["---", " Sensor Fault ", "3"], [0, 1]),
        ("missing: 0.1", ["0.1", "0.10000000149011612", "0.1000000001"], [0, 1]),
        # a column's marks stand for those of all
        ("missing: -1\ncolumns: {x: {column: x, missing: [-2, -3]}}", ["-1", "-2", "-3"], [1, 2]),
        # before scale and offset
        ("columns: {x: {column: x, scale: 2, offset: 1, missing: 7}}", ["3", "7", "15"], [1]),
    ],
)
def test_marked_cells_are_missing(
    tmp_path: Path, keys: str, cells: list[str], rows: list[int]
) -> None:
    assert missing_rows(tmp_path, keys, cells) == rows


def test_the_marks_of_a_set_stand_for_those_of_all(tmp_path: Path) -> None:
    keys = (
        "source: {train: {files: a.csv, missing: -1}, val: b.csv}\n"
        "missing: -2\ntime: time\nnan: split\n"
    )
    text = "time,x,F\n0,-1,0\n0.2,-2,0\n"
    assert missing_rows(tmp_path, keys, [], **{"a.csv": text, "b.csv": text}) == [0, 3]


def test_a_missing_input_is_reported_with_its_cell(tmp_path: Path) -> None:
    with pytest.raises(SpecError) as caught:
        missing_rows(tmp_path, SOURCE.replace("split", "error") + "missing: [-5]\n", ["1", "-5"])
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0809"
    assert fault.span is not None
    assert (fault.span.line, fault.span.column) == (3, 5)


def test_the_advice_about_a_text_reads_the_file(tmp_path: Path) -> None:
    cells = ["1", "#DIV/0!", "3"]
    with pytest.raises(SpecError) as caught:
        missing_rows(tmp_path, "", cells)
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0807"
    key = (fault.help or "").split("`")[1]
    assert missing_rows(tmp_path, key, cells) == [1]


def test_a_time_has_no_marks(tmp_path: Path) -> None:
    with pytest.raises(SpecError) as caught:
        load(tmp_path, SOURCE + "missing: -1\n", {"log.csv": "time,x,F\n0,1,1\n-1,2,2\n0.4,3,3\n"})
    assert [fault.code for fault in caught.value.diagnostics] == ["E0813"]


SPEC = """
msnn: 1
name: plant
sample_time: 0.2 s
inputs: {x: m}
outputs: {y: "x * 2"}
data:
  source: {train: log.csv}
  time: time
  nan: split
  missing: [-9999, off]
"""
TIMES, CELLS = [0.0, 0.2, 0.4], [1.0, "Off", 3.0]


@pytest.mark.parametrize(
    "frame",
    [
        pd.DataFrame({"time": TIMES, "x": [1, -9999, 3]}),
        pd.DataFrame({"time": TIMES, "x": np.array([1, -9999, 3], np.float32)}),
        pd.DataFrame({"time": TIMES, "x": CELLS}),
        pl.DataFrame({"time": TIMES, "x": [1, -9999, 3]}),
        {"time": TIMES, "x": [1, -9999, 3]},
        {"time": TIMES, "x": np.array(CELLS, object)},
    ],
)
def test_frames_have_marks(tmp_path: Path, frame: Any) -> None:
    (tmp_path / "plant.yaml").write_text(SPEC)
    model = msnn.load(tmp_path / "plant.yaml")
    assert [run.steps for run in msnn.simulate(model, data=frame)] == [1, 1]


def test_a_text_that_is_no_mark_is_refused_in_frames(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(SPEC)
    frame = pd.DataFrame({"time": TIMES, "x": [1.0, "fault", 3.0]})
    with pytest.raises(SpecError, match="objects"):
        msnn.simulate(msnn.load(tmp_path / "plant.yaml"), data=frame)


@pytest.mark.parametrize(("mark", "code"), [(".inf", "E0210"), (".nan", "E0210"), ("~", "E0212")])
def test_what_is_no_mark(tmp_path: Path, mark: str, code: str) -> None:
    with pytest.raises(SpecError) as caught:
        missing_rows(tmp_path, f"columns: {{x: {{column: x, missing: [-1, {mark}]}}}}", ["1"])
    assert caught.value.diagnostics[0].code == code
