"""Columns of frames and mappings are found whatever their labels are: numbers, pairs, doubles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest

import msnn
from msnn.data.dataset import Dataset
from msnn.data.reading.frames import frame_data
from spec_schema.diagnostics.diagnostic import SpecError
from tests.data.unit_files import SPEC, TIME, V, load


def read(folder: Path, frame: Any, column: str = "v", time: str = "time") -> Dataset:
    spec = folder / "car.msnn.yaml"
    layout = f"  time: {time}\n  columns: {{v: {column}}}\n"
    spec.write_text(SPEC.replace("UNIT", "m/s").replace("FILE", "none.csv") + layout)
    model = msnn.load(spec)
    assert model.spec.data is not None
    return frame_data(model.program, model.spec.data, frame, model.spec.data.place, {})


@pytest.mark.parametrize(
    ("labels", "column", "time", "first"),
    [
        # a number in the spec is an index, and a label in quotes
        ((0, 1), "1", "0", 36.0),
        ((10, 20), "'20'", "'10'", 36.0),
        ((10, 20), "1", "0", 36.0),
        ((1.5, 2.5), "'2.5'", "'1.5'", 36.0),
        # headers of two lines, the second one of units
        ((("log", "time"), ("log", "v")), "log.v", "log.time", 36.0),
        ((("time", "s"), ("v", "km/h")), "v", "time", 10.0),
        ((("time", "s"), ("v", "km/h")), "'v [km/h]'", "time", 10.0),
        ((("time", ""), ("v", "km/h")), "v", "time", 10.0),
        ((("time", "Unnamed: 0_level_1"), ("v", "km/h")), "v", "time", 10.0),
        ((("a", "time", "s"), ("a", "v", "km/h")), "a.v", "a.time", 10.0),
    ],
)
def test_labels_of_pandas_are_names(
    tmp_path: Path, labels: Any, column: str, time: str, first: float
) -> None:
    frame = pd.DataFrame({0: TIME, 1: V})
    frame.columns = pd.Index(labels)
    assert read(tmp_path, frame, column, time).series["v"][0] == first


def test_labels_of_a_mapping_are_names(tmp_path: Path) -> None:
    assert read(tmp_path, {"time": TIME, 1: V}, "'1'").series["v"].tolist() == V.tolist()
    assert read(tmp_path, {0: TIME, 1: V}, "1", "0").series["v"].tolist() == V.tolist()
    with pytest.raises(SpecError, match="E0804"):
        read(tmp_path, {"time": TIME, 1: V})


@pytest.mark.parametrize("column", ["v", "1", "2"])
def test_a_name_that_a_frame_has_twice_is_refused(tmp_path: Path, column: str) -> None:
    frame = pd.DataFrame({0: TIME, 1: V, 2: 2 * V})
    frame.columns = pd.Index(["time", "v", "v"])
    with pytest.raises(SpecError) as caught:
        read(tmp_path, frame, column)
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0814"
    # the advice
    frame.columns = pd.Index(["time", "v", "w"])
    assert fault.help == "give each column a name of its own"
    assert read(tmp_path, frame).series["v"].tolist() == V.tolist()
    # others than the wanted column may be double
    frame.columns = pd.Index(["v", "time", "time"])
    assert read(tmp_path, frame, "v", "v").series["v"].tolist() == TIME.tolist()
    with pytest.raises(SpecError, match="E0814"):
        read(tmp_path, {"time": TIME, 1: V, "1": V}, "'1'")


def test_a_name_that_parquet_has_twice_is_refused(tmp_path: Path) -> None:
    table = arrow.Table.from_arrays([TIME, V, 2 * V], names=["time", "v", "v"])
    parquet.write_table(table, tmp_path / "a.parquet")
    for column in ("v", "1", "2"):
        layout = f"  time: time\n  columns: {{v: {column}}}\n"
        with pytest.raises(SpecError, match="E0814"):
            load(tmp_path, "a.parquet", "m/s", layout)


@pytest.mark.parametrize(
    "column",
    [
        pd.Series([1, 2, 3, 4], dtype="Int64"),
        pd.Series([1.0, 2.0, 3.0, 4.0], dtype="Float64"),
        pd.Series([1, 2, 3, 4], dtype="int64[pyarrow]"),
        pl.Series([1, 2, 3, 4], dtype=pl.Int16),
    ],
)
def test_numbers_of_other_types_are_read(tmp_path: Path, column: Any) -> None:
    make: Any = pl.DataFrame if isinstance(column, pl.Series) else pd.DataFrame
    found = read(tmp_path, make({"time": TIME, "v": column})).series["v"]
    assert found.tolist() == [1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    "column",
    [
        pd.Series([1, None, 3, 4], dtype="Int64"),
        pd.Series([True, None, True, True], dtype="boolean"),
        pd.Series([1.0, None, 3.0, 4.0], dtype="double[pyarrow]"),
        pl.Series([1, None, 3, 4]),
    ],
)
def test_numbers_that_a_frame_lacks_are_missing(tmp_path: Path, column: Any) -> None:
    make: Any = pl.DataFrame if isinstance(column, pl.Series) else pd.DataFrame
    with pytest.raises(SpecError, match="column `v` has `NaN` in row 1"):
        read(tmp_path, make({"time": TIME, "v": column}))


@pytest.mark.parametrize(
    "attrs",
    [
        {"units": {"v": "km/h"}},
        {"v": {"units": "km/h"}},
        {"v_unit": "km/h"},
        {"unit": {"v": "kph"}, "units": {"v": "km/h"}},
    ],
)
def test_attributes_of_a_frame_state_units(tmp_path: Path, attrs: dict[Any, Any]) -> None:
    frame = pd.DataFrame({"time": TIME, "v": V})
    frame.attrs = attrs
    assert read(tmp_path, frame).series["v"][0] == pytest.approx(10)
    frame.attrs = {**attrs, "Unit": {"v": "m/s"}}
    with pytest.raises(SpecError, match="E0991"):
        read(tmp_path, frame)


def test_numpy_is_no_frame(tmp_path: Path) -> None:
    with pytest.raises(TypeError):
        read(tmp_path, np.zeros((4, 2)))


INDICES: dict[str, Any] = {
    "dates": pd.date_range("2026-01-01", periods=4, freq="100ms", name="clock"),
    "dates with a zone": pd.date_range(
        "2026-03-29 01:59:59.9", periods=4, freq="100ms", tz="Europe/Rome", name="clock"
    ),
    "durations": pd.Index(pd.to_timedelta(100 * np.arange(4), unit="ms"), name="clock"),
    "seconds": pd.Index(TIME, name="clock"),
}


@pytest.mark.parametrize("kind", INDICES)
def test_the_index_of_a_frame_is_a_column_as_in_its_parquet_file(tmp_path: Path, kind: str) -> None:
    frame = pd.DataFrame({"v": V}, index=INDICES[kind])
    data = read(tmp_path, frame, time="clock")
    assert data.series["v"].tolist() == V.tolist()
    assert data.episodes("train").tolist() == [[0, 4]]
    frame.to_parquet(tmp_path / "a.parquet")
    saved = load(tmp_path, "a.parquet", "m/s", "  time: clock\n")
    assert saved.episodes("train").tolist() == [[0, 4]]
    with pytest.raises(SpecError, match="E0812"):
        read(tmp_path, frame.iloc[::2], time="clock")
    # columns keep their places
    assert read(tmp_path, frame, column="0", time="clock").series["v"][0] == 36.0


def test_an_index_without_a_name_has_that_of_parquet(tmp_path: Path) -> None:
    frame = pd.DataFrame({"v": V}, index=INDICES["dates"].rename(None))
    data = read(tmp_path, frame, time="__index_level_0__")
    assert data.episodes("train").tolist() == [[0, 4]]
    # one that counts rows is no column
    with pytest.raises(SpecError, match="E0804"):
        read(tmp_path, pd.DataFrame({"v": V}, index=[3, 4, 5, 6]), time="__index_level_0__")


def test_a_column_goes_before_an_index_of_its_name(tmp_path: Path) -> None:
    frame = pd.DataFrame({"v": V, "time": TIME}, index=pd.Index(2 * TIME, name="time"))
    assert read(tmp_path, frame).episodes("train").tolist() == [[0, 4]]


@pytest.mark.parametrize("kind", ["dates", "dates with a zone", "durations"])
@pytest.mark.parametrize(("every", "codes"), [(1, []), (2, ["W0811"])])
def test_an_index_of_other_times_that_nobody_reads_is_reported(
    tmp_path: Path, kind: str, every: int, codes: list[str]
) -> None:
    first = INDICES[kind][0]
    index = pd.Index([first + every * (moment - first) for moment in INDICES[kind]], name="clock")
    frame = pd.DataFrame({"v": V}, index=index)
    spec = tmp_path / "car.msnn.yaml"
    spec.write_text(SPEC.replace("UNIT", "m/s").replace("FILE", "none.csv"))
    model = msnn.load(spec)
    section = model.spec.data
    assert section is not None
    data = frame_data(model.program, section, frame, section.place, {})
    assert [warning.code for warning in data.warnings] == codes
    for warning in data.warnings:
        assert "`time: clock`" in str(warning.help)
        # the advice reads the times
        with pytest.raises(SpecError, match="E0812"):
            read(tmp_path, frame, time="clock")
