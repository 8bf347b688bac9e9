"""`duplicates:` makes one row of successive rows with the same time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest
from asammdf import MDF, Signal

import msnn
from spec_schema.diagnostics.diagnostic import SpecError
from tests.data.specs import load

SOURCE = "source: {train: log.csv}\ntime: time\n"
LOG = "time,x,F\n0.0,1,5\n0.2,2,6\n0.2,4,\n0.2,6,8\n0.4,3,9\n0.6,7,1\n0.6,8,1\n"
NAN = np.nan


@pytest.mark.parametrize(
    ("how", "x", "force", "rows"),
    [
        ("first", [1, 2, 3, 7], [5, 6, 9, 1], [0, 1, 4, 5]),
        ("last", [1, 6, 3, 8], [5, 8, 9, 1], [0, 3, 4, 6]),
        ("mean", [1, 4, 3, 7.5], [5, 7, 9, 1], [0, 1, 4, 5]),
    ],
)
@pytest.mark.parametrize("of_set", [False, True])
@pytest.mark.parametrize("resample", ["error", "linear"])
def test_one_row_per_time(
    tmp_path: Path, how: str, x: list[float], force: list[float], rows: list[int],
    of_set: bool, resample: str,
) -> None:  # fmt: skip
    key = f"duplicates: {how}"
    section = f"source: {{train: {{files: log.csv{f', {key}' if of_set else ''}}}}}\ntime: time\n"
    section += f"resample: {resample}\n" + ("" if of_set else key)
    data = load(tmp_path, section, {"log.csv": LOG})
    np.testing.assert_allclose(data.series["x"], x, rtol=1e-12)
    np.testing.assert_allclose(data.series["F"], force, rtol=1e-12)
    # rows have the numbers that the file has
    assert list(data.records[0].pieces[0].rows) == rows
    assert data.records[0].place(2) == "row 4 of log.csv"


def test_the_key_of_a_set_stands_for_that_of_all(tmp_path: Path) -> None:
    section = "source: {train: {files: a.csv, duplicates: last}, val: a.csv}\ntime: time\n"
    data = load(tmp_path, section + "duplicates: first\n", {"a.csv": LOG})
    assert data.series["x"].tolist() == [1, 6, 3, 8, 1, 2, 3, 7]


def test_first_and_last_keep_empty_cells_and_mean_does_not(tmp_path: Path) -> None:
    log = "time,x,F\n0,,1\n0,2,\n0.2,,\n0.2,,3\n"
    found = {
        how: load(tmp_path, f"{SOURCE}nan: split\nduplicates: {how}", {"log.csv": log}).series
        for how in ("first", "last", "mean")
    }
    for how, x, force in (
        ("first", [NAN, NAN], [1, NAN]),
        ("last", [2, NAN], [NAN, 3]),
        ("mean", [2, NAN], [1, 3]),
    ):
        np.testing.assert_array_equal(found[how]["x"], x)
        np.testing.assert_array_equal(found[how]["F"], force)


def test_the_mean_of_equal_values_is_that_value(tmp_path: Path) -> None:
    log = "time,x,F\n" + "0,0.1,-0.7\n" * 3 + "0.2,1e300,-1e-300\n" * 7
    series = load(tmp_path, SOURCE + "duplicates: mean", {"log.csv": log}).series
    assert series["x"].tolist() == [0.1, 1e300]
    assert series["F"].tolist() == [-0.7, -1e-300]


@pytest.mark.parametrize(
    ("keys", "x"),
    [
        ("from: 3", [6, 3, 8]),
        ("from: 4", [3, 8]),
        ("to: 2", [1]),
        ("to: 3", [1, 6]),
        ("every: 2\nresample: none", [1, 3]),
        ("from: 0.2 s\nto: 0.4 s", [6, 3]),
    ],
)
def test_rows_are_picked_by_their_numbers_in_the_file(
    tmp_path: Path, keys: str, x: list[float]
) -> None:
    data = load(tmp_path, f"{SOURCE}duplicates: last\n{keys}", {"log.csv": LOG})
    assert data.series["x"].tolist() == x


def test_joined_files_keep_the_numbers_of_their_rows(tmp_path: Path) -> None:
    second = "time,x,F\n0.8,1,1\n0.8,2,2\n1.0,3,3\n"
    section = "source: {train: '*.csv'}\ntime: time\njoin: true\nduplicates: last\n"
    data = load(tmp_path, section + "from: 3\n", {"a.csv": LOG, "b.csv": second})
    assert data.series["x"].tolist() == [6, 3, 8, 2, 3]
    places = [data.records[0].place(row) for row in range(5)]
    own = [f"row {row} of a.csv" for row in (3, 4, 6)]
    assert places == [*own, "row 1 of b.csv", "row 2 of b.csv"]
    # 7 rows of the first file, then the second: row 8 is 0.8 s
    picked = load(tmp_path, section + "from: 8\n")
    assert picked.series["x"].tolist() == [2, 3]


def test_messages_have_the_row_of_the_file(tmp_path: Path) -> None:
    log = LOG.replace("0.4,3,9", "0.4,,9")
    with pytest.raises(SpecError) as caught:
        load(tmp_path, SOURCE + "duplicates: last", {"log.csv": log})
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0809"
    assert "row 4 of log.csv" in fault.message
    assert fault.span is not None
    assert (fault.span.line, fault.span.column) == (6, 5)


def test_a_time_that_comes_back_later_is_no_duplicate(tmp_path: Path) -> None:
    log = "time,x,F\n0,1,1\n0.2,1,1\n0.2,2,1\n0,1,1\n0.2,1,1\n"
    with pytest.raises(SpecError) as caught:
        load(tmp_path, SOURCE + "duplicates: first", {"log.csv": log})
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0813"
    assert "row 3 of log.csv" in fault.message
    assert "another recording begins there" in str(fault.help)


@pytest.mark.parametrize("keys", ["duplicates: error", "duplicates: error\nresample: none", ""])
def test_without_the_key_they_are_an_error(tmp_path: Path, keys: str) -> None:
    with pytest.raises(SpecError) as caught:
        load(tmp_path, SOURCE + keys, {"log.csv": LOG.replace("4,\n", "4,7\n")})
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0813"
    assert "row 2 of log.csv" in fault.message
    assert fault.span is not None
    assert fault.span.line == 4


def test_repeated_rows_that_are_not_picked_are_no_error(tmp_path: Path) -> None:
    section = SOURCE + "duplicates: error\nresample: none\nfrom: 3\nto: 4\n"
    assert load(tmp_path, section, {"log.csv": LOG}).rows == 2


def _write_mdf(path: Path, times: list[list[float]]) -> None:
    with MDF(version="4.10") as file:
        for name, time in zip("xF", times, strict=True):
            file.append([Signal(np.arange(len(time)) + 1.0, np.array(time), name=name)])
        file.save(path, overwrite=True)


def test_each_stream_has_duplicates_of_its_own(tmp_path: Path) -> None:
    _write_mdf(tmp_path / "a.mf4", [[0, 0.2, 0.2, 0.4], [0, 0, 0.1, 0.2, 0.3, 0.4]])
    section = "source: {train: a.mf4}\nresample: linear\n"
    with pytest.raises(SpecError, match="E0813") as caught:
        load(tmp_path, section)
    key = str(caught.value.diagnostics[0].help).split("`")[1]
    for how, x, force in (
        (key, [1, 2, 4], [1, 4, 6]),
        ("duplicates: last", [1, 3, 4], [2, 4, 6]),
        ("duplicates: mean", [1, 2.5, 4], [1.5, 4, 6]),
    ):
        data = load(tmp_path, section + how)
        np.testing.assert_allclose(data.series["x"], x)
        np.testing.assert_allclose(data.series["F"], force)


def test_streams_of_one_time_are_rows(tmp_path: Path) -> None:
    _write_mdf(tmp_path / "a.mf4", [[0, 0.2, 0.2, 0.4]] * 2)
    data = load(tmp_path, "source: {train: a.mf4}\nduplicates: last\nto: 1 s\n")
    assert data.series["x"].tolist() == [1, 3, 4]
    assert list(data.records[0].pieces[0].rows) == [0, 2, 3]


def test_joined_streams(tmp_path: Path) -> None:
    _write_mdf(tmp_path / "a.mf4", [[0, 0.2, 0.2, 0.4], [0, 0.2, 0.4]])
    _write_mdf(tmp_path / "b.mf4", [[0.6, 0.6, 0.8], [0.6, 0.8, 0.8, 0.8]])
    section = "source: {train: '*.mf4'}\nresample: linear\njoin: true\nduplicates: last\n"
    data = load(tmp_path, section)
    assert len(data.records) == 1
    np.testing.assert_allclose(data.series["x"], [1, 3, 4, 2, 3])
    np.testing.assert_allclose(data.series["F"], [1, 2, 3, 1, 4])


TIMES = [0.0, 0.2, 0.2, 0.4]


@pytest.mark.parametrize(
    "frame",
    [
        pd.DataFrame({"time": TIMES, "x": [1.0, 2, 4, 3]}),
        pl.DataFrame({"time": TIMES, "x": [1.0, 2, 4, 3]}),
        {"time": TIMES, "x": [1.0, 2, 4, 3]},
    ],
)
def test_frames_have_duplicates(tmp_path: Path, frame: Any) -> None:
    keys = "source: {train: log.csv}, time: time, duplicates: mean"
    spec = "msnn: 1\nname: plant\nsample_time: 0.2 s\ninputs: {x: m}\noutputs: {y: x * 2}\n"
    (tmp_path / "plant.yaml").write_text(f"{spec}data: {{{keys}}}\n")
    (run,) = msnn.simulate(msnn.load(tmp_path / "plant.yaml"), data=frame)
    np.testing.assert_allclose(run.outputs["y"], [2, 6, 6])
