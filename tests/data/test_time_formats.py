"""`time: {format, zone}` reads dates as loggers of other countries write them."""

from __future__ import annotations

import random
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import h5py
import numpy as np
import openpyxl
import pandas as pd
import polars as pl
import pytest
from scipy.io import savemat

import msnn
from msnn.data.reading.local_times import utc_times
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.errors.schema import unknown_zone
from spec_schema.expressions.moments import Moment, read_moment
from spec_schema.expressions.time_format import FormatFault, TimeFormat, time_format
from spec_schema.expressions.time_zones import near_zones
from tests.data.specs import load


def moment(text: str, cell: str) -> Moment | None:
    found = time_format(text)
    assert isinstance(found, TimeFormat)
    return found.moment(cell)


@pytest.mark.parametrize(
    ("text", "cell", "date"),
    [
        ("%d/%m/%Y %H:%M:%S", "22/11/2026 17:00:05", "2026-11-22 17:00:05"),
        ("%d.%m.%y %H:%M", "1.2.69 7:5", "1969-02-01 07:05"),
        ("%d.%m.%y", "01.02.68", "2068-02-01"),
        ("%Y%m%d%H%M%S%f", "20261122170005123456789", "2026-11-22 17:00:05.123456789"),
        ("%S.%f %M %H %j %Y", "5.000000001 0 17 326 2026", "2026-11-22 17:00:05.000000001"),
        ("%Y-%m-%d %H:%M:%S,%f", "2026-11-22 17:00:05,5", "2026-11-22 17:00:05.5"),
        ("%m/%d/%Y %I:%M %p", "11/22/2026 12:30 am", "2026-11-22 00:30"),
        ("%m/%d/%Y %I:%M %p", "11/22/2026 12:30 PM", "2026-11-22 12:30"),
        ("%a %b %d %H:%M:%S %Y", "Sun Nov  22 17:00:05 2026", "2026-11-22 17:00:05"),
        ("%A, %d %B %Y", "sunday, 22 NOVEMBER 2026", "2026-11-22"),
        ("%Y-%m-%dT%H:%M%z", "2026-11-22T17:00+0130", "2026-11-22 15:30Z"),
        ("%Y-%m-%d %H:%M CET %%", "2026-11-22 17:00 CET %", "2026-11-22 17:00"),
    ],
)
def test_dates_in_a_format(text: str, cell: str, date: str) -> None:
    assert moment(text, cell) == read_moment(date)


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        ("%d/%m/%Y", "31/04/2026"),
        ("%d/%m/%Y", "11/22/2026"),
        ("%d/%m/%Y", "22/11/26"),
        ("%d/%m/%Y", "22/11/2026 "),
        ("%d/%m/%Y", "22/11/1700"),
        ("%Y%m%d", "2026112"),
        ("%Y-%j", "2025-366"),
        ("%Y-%j", "2025-0"),
        ("%Y-%m-%d %I:%M %p", "2026-11-22 13:00 PM"),
        ("%Y-%m-%d %I:%M %p", "2026-11-22 0:00 AM"),
        ("%Y-%m-%d %H:%M:%S", "2026-11-22 17:00:60"),
        ("%Y-%m-%d %H:%M:%S.%f", "2026-11-22 17:00:00.1234567891"),
        ("%a %Y-%m-%d", "Mon 2026-11-22"),
        ("%Y-%m-%d", "\u0662026-11-22"),
    ],
)
def test_cells_that_do_not_fit(text: str, cell: str) -> None:
    assert moment(text, cell) is None


def test_dates_are_read_as_datetime_reads_them() -> None:
    rng = random.Random(1)
    for _ in range(2000):
        when = datetime(1990, 1, 1, tzinfo=UTC) + timedelta(seconds=rng.uniform(0, 2e9))
        day = rng.choice(["%d/%m/%Y", "%d %b %y", "%B %d, %Y", "%Y-%j", "%a %d.%m.%Y", "%Y%m%d"])
        clock = rng.choice(["", " %H:%M", "T%H%M%S", " %I:%M:%S %p", "-%H:%M:%S.%f", " %H:%M:%S%z"])
        cell = when.strftime(day + clock)
        right = datetime.strptime(cell, day + clock).replace(tzinfo=UTC)
        found = moment(day + clock, cell)
        assert found is not None
        micro = (right - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1)
        assert found.nanoseconds == 1000 * micro, (day + clock, cell)


@pytest.mark.parametrize("text", ["", "%", "%Y", "%Y-%m-%d %p", "%Y-%m %H", "%H:%M", "%y-%Y-%d-%m"])
def test_formats_with_a_mistake(text: str) -> None:
    assert isinstance(time_format(text), FormatFault)


TIMES = ["22.11.2026 17:00:00,0", "22.11.2026 17:00:00,2", "22.11.2026 17:00:00,400000001"]
FORMAT = "%d.%m.%Y %H:%M:%S,%f"
KEY = f'time: {{column: time, format: "{FORMAT}"}}\n'


def write_xlsx(path: Path) -> None:
    book = openpyxl.Workbook()
    sheet: Any = book.worksheets[0]
    for row in zip(["time", *TIMES], ["x", 1, 2, 3], ["F", 4, 5, 6], strict=True):
        sheet.append(row)
    book.save(path)


def write_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["time"], file["x"], file["F"] = TIMES, [1.0, 2, 3], [4.0, 5, 6]


COLUMNS: dict[str, Any] = {"time": np.array(TIMES), "x": [1.0, 2, 3], "F": [4.0, 5, 6]}
WRITERS: dict[str, Any] = {
    "csv": lambda path: pd.DataFrame(COLUMNS).to_csv(path, index=False, sep="\t"),
    "xlsx": write_xlsx,
    "parquet": lambda path: pd.DataFrame(COLUMNS).to_parquet(path),
    "npz": lambda path: np.savez(path, **COLUMNS),
    "h5": write_hdf5,
}


@pytest.mark.parametrize("kind", WRITERS)
def test_every_format_with_texts_has_them(tmp_path: Path, kind: str) -> None:
    WRITERS[kind](tmp_path / f"a.{kind}")
    data = load(tmp_path, f"source: {{train: a.{kind}}}\n{KEY}to: 2026-11-22 17:00:00.3\n")
    assert data.series["x"].tolist() == [1, 2]
    time = load(tmp_path, f"source: {{train: a.{kind}}}\n{KEY}").records[0].pieces[0].time
    assert time is not None
    assert time.tolist() == [0, 0.2, 0.400000001]


@pytest.mark.parametrize("kind", ["pandas", "polars", "mapping"])
def test_frames_have_formats_and_zones(tmp_path: Path, kind: str) -> None:
    columns = {key: list(values) for key, values in COLUMNS.items()}
    frame: Any = {"pandas": pd.DataFrame, "polars": pl.DataFrame, "mapping": dict}[kind](columns)
    spec = "msnn: 1\nname: plant\nsample_time: 0.2 s\ninputs: {x: m}\noutputs: {y: x * 2}\n"
    key = KEY.strip().replace("}", ", zone: Europe/Berlin}")
    (tmp_path / "plant.yaml").write_text(f"{spec}data:\n  source: {{log: a.csv}}\n  {key}\n")
    (run,) = msnn.simulate(msnn.load(tmp_path / "plant.yaml"), data=frame)
    assert np.asarray(run.outputs["y"]).tolist() == [2, 4, 6]


def fault_of(folder: Path, keys: str, times: list[str], name: str = "log.csv") -> Diagnostic:
    rows = "".join(f"{time};{row};0\n" for row, time in enumerate(times))
    section = f"source: {{train: {name}}}\nresample: linear\ncsv: {{delimiter: ';'}}\n{keys}"
    with pytest.raises(SpecError) as caught:
        load(folder, section, {"log.csv": "time;x;F\n" + rows})
    (fault,) = caught.value.diagnostics
    return fault


def test_cells_of_another_format_are_counted(tmp_path: Path) -> None:
    fault = fault_of(tmp_path, KEY, [TIMES[0], "22.11.2026", "yesterday", TIMES[2]])
    assert fault.code == "E0887"
    assert fault.message == f"`22.11.2026` in column `time` does not fit the format `{FORMAT}`"
    assert fault.notes == ("row 1 of log.csv", "1 more cell of this kind in the file")
    assert fault.span is not None
    assert (fault.span.line, fault.span.column) == (3, 1)
    fault = fault_of(tmp_path, KEY, [TIMES[0], ""])
    assert fault.code == "E0809"
    fault = fault_of(tmp_path, KEY, ["2026-11-22 17:00:00", "2026-11-22 17:00:01"])
    assert "remove `format:`" in str(fault.help)


def test_digits_are_a_date_with_a_format(tmp_path: Path) -> None:
    text = "time,x,F\n20261122235959,1,1\n20261123000000,2,2\n"
    key = 'time: {column: time, format: "%Y%m%d%H%M%S"}\nresample: none\n'
    data = load(tmp_path, "source: {train: a.csv}\n" + key, {"a.csv": text})
    assert np.asarray(data.records[0].pieces[0].time).tolist() == [0, 1]


BERLIN = "time: {column: time, zone: Europe/Berlin}\n"


def loaded(folder: Path, keys: str, times: list[str]) -> list[float]:
    text = "time,x,F\n" + "".join(f"{time},{row},0\n" for row, time in enumerate(times))
    section = f"source: {{train: log.csv}}\nresample: none\n{keys}"
    time = load(folder, section, {"log.csv": text}).records[0].pieces[0].time
    return np.asarray(time).tolist()


def test_the_hour_that_is_there_twice_is_told_by_the_order(tmp_path: Path) -> None:
    times = ["01:59:59", "02:00:00", "02:59:59", "02:00:00", "02:59:59", "03:00:00"]
    dates = [f"2026-10-25 {time}" for time in times]
    assert loaded(tmp_path, BERLIN, dates) == [0, 1, 3600, 3601, 7200, 7201]
    # the beginning of summer time: an hour that no clock shows
    dates = ["2026-03-29 01:59:59", "2026-03-29 03:00:00.000000001"]
    assert loaded(tmp_path, BERLIN, dates) == [0, 1.000000001]
    # dates of the spec have the offset of UTC
    keys = BERLIN + "from: 2026-03-29 01:00:00Z\n"
    assert loaded(tmp_path, keys, dates) == [1.000000001]


@pytest.mark.parametrize(
    ("times", "row", "more"),
    [
        # without a step back
        (
            ["01:50:00", "02:10:00", "02:50:00", "03:00:00"],
            1,
            "1 more cell of this kind in the file",
        ),
        # with two
        (
            ["02:50:00", "02:10:00", "02:50:00", "02:10:00"],
            0,
            "3 more cells of this kind in the file",
        ),
    ],
)
def test_doubtful_hours_are_refused(tmp_path: Path, times: list[str], row: int, more: str) -> None:
    dates = [f"2026-10-25 {time}" for time in times]
    fault = fault_of(tmp_path, BERLIN, dates)
    assert fault.code == "E0888"
    assert f"the time `{dates[row]}` of column `time` is there twice" in fault.message
    assert fault.notes == (f"row {row} of log.csv", more)
    assert fault.span is not None
    assert fault.span.line == 2 + row


def test_a_skipped_hour_is_refused_and_the_advice_reads_it(tmp_path: Path) -> None:
    dates = ["2026-03-29 01:30:00", "2026-03-29 02:30:00", "2026-03-29 02:59:59.5"]
    fault = fault_of(tmp_path, BERLIN, dates)
    assert fault.code == "E0888"
    assert "`2026-03-29 02:30:00` of column `time` is skipped" in fault.message
    zone = str(fault.help).split("`")[1]
    assert zone == "zone: Etc/GMT-1"
    key = f"time: {{column: time, {zone}}}\n"
    assert loaded(tmp_path, key, dates) == [0, 3600, 5399.5]


@pytest.mark.parametrize(
    ("keys", "times", "code"),
    [
        (BERLIN, ["0", "0.2"], "E0889"),
        (BERLIN, ["2026-11-22 17:00:00Z", "2026-11-22 17:00:01Z"], "E0889"),
    ],
)
def test_times_without_need_of_a_zone(
    tmp_path: Path, keys: str, times: list[str], code: str
) -> None:
    assert fault_of(tmp_path, keys, times).code == code


def test_arrays_of_numbers_and_dates_have_no_format(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", time=[0, 0.2], x=[1.0, 2], F=[1.0, 2])
    savemat(tmp_path / "a.mat", {"time": [0, 0.2], "x": [1.0, 2], "F": [1.0, 2]})
    dates = pd.to_datetime(["2026-11-22 17:00:00.0", "2026-11-22 17:00:00.2"])
    pd.DataFrame({"time": dates, "x": [1.0, 2], "F": [1.0, 2]}).to_parquet(tmp_path / "a.parquet")
    for name in ("a.npz", "a.mat", "a.parquet"):
        with pytest.raises(SpecError) as caught:
            load(tmp_path, f"source: {{train: {name}}}\n{KEY}")
        assert [fault.code for fault in caught.value.diagnostics] == ["E0889"]
    # a zone of dates is no format
    data = load(tmp_path, f"source: {{train: a.parquet}}\n{BERLIN}from: 2026-11-22 16:00:00.1Z")
    assert data.series["x"].tolist() == [2]


@pytest.mark.parametrize(
    "name", ["Europe/Berlin", "America/St_Johns", "Australia/Lord_Howe", "Africa/Casablanca", "UTC"]
)
def test_utc_is_that_of_zoneinfo(name: str) -> None:
    zone = ZoneInfo(name)
    begin = datetime(2025, 1, 1, tzinfo=UTC)
    # every 10 minutes of a year: each hour that is there twice has one step back
    clock = [(begin + timedelta(minutes=10 * k)).astimezone(zone) for k in range(52_560)]
    local = [(when.replace(tzinfo=UTC) - begin).total_seconds() for when in clock]
    first = Moment(int(clock[0].replace(tzinfo=UTC).timestamp()) * 10**9, False)
    found = utc_times(np.array(local) - local[0], first, name)
    assert len(found.skipped) == len(found.doubtful) == 0
    assert found.begins == Moment(int(begin.timestamp()) * 10**9, True)
    np.testing.assert_array_equal(found.seconds, 600.0 * np.arange(len(clock)))


@pytest.mark.parametrize(
    "times",
    [
        ["22.11.2026 17:00:00.00", "22.11.2026 17:00:00.20"],
        ["11/22/2026 17:00", "11/22/2026 17:01"],
        ["22/11/26 17:00:00", "22/11/26 17:00:01"],
        ["1.11.2026", "2.11.2026"],
    ],
)
def test_the_advice_about_a_date_reads_it(tmp_path: Path, times: list[str]) -> None:
    fault = fault_of(tmp_path, "time: time\n", times)
    assert fault.code == "E0807"
    key = str(fault.help).split("`")[3]
    step = loaded(tmp_path, key + "\n", times)[1]
    assert step in (0.2, 60, 1, 86400)


def test_a_machine_without_zones_is_told_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zoneinfo.available_timezones", set[str])
    assert near_zones("Europe/Berln") is None
    fault = unknown_zone(
        "Europe/Berln", None, Span(file="a.yaml", line=1, column=1, end_line=1, end_column=2)
    )
    assert "`pip install tzdata`" in str(fault.help)
