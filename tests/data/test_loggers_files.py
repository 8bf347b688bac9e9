"""Files as loggers write them are data: dates, units, words for nothing, blanks, workbooks."""

from __future__ import annotations

import gzip
import subprocess
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pandas as pd
import pytest

import msnn
from msnn.data.formats import table_of_formats
from msnn.packages import OPENPYXL, OptionalPackage
from spec_schema.diagnostics.diagnostic import SpecError

SPEC = """\
msnn: 1
name: plant
sample_time: 0.5 s
inputs: {F: {unit: N}, x: {unit: m}}
constants: {softness: 1 m/N}
outputs: {y: {expr: F * softness + x, unit: m}}
data:
  source: {train: FILE}
  time: time
"""
FORCE = [1.0, 2.0, 4.0]
PLACE = [0.1, 0.2, 0.3]


def read(
    folder: Path, text: str, *, spec: str = SPEC, name: str = "log.csv", **layout: Any
) -> msnn.Simulations:
    """What a free run reads of a file."""
    (folder / name).write_text(text, encoding="utf-8")
    return simulated(folder, name, spec=spec, **layout)


def simulated(folder: Path, name: str, *, spec: str = SPEC, **layout: Any) -> Any:
    (folder / "plant.msnn.yaml").write_text(spec.replace("FILE", name))
    settings = {f"data.{key}": value for key, value in layout.items()}
    return msnn.simulate(msnn.load(folder / "plant.msnn.yaml", settings))


def output(runs: Sequence[Any]) -> list[float]:
    (run,) = runs
    return run.outputs["y"].tolist()


PLAIN = np.array(FORCE) + np.array(PLACE)
GOOD: dict[str, str] = {
    "semicolons": "time;F;x\n0;1;0.1\n0.5;2;0.2\n1;4;0.3\n",
    "tabs": "time\tF\tx\n0\t1\t0.1\n0.5\t2\t0.2\n1\t4\t0.3\n",
    "blanks": "time   F  x\n 0   1   0.1\n 0.5 2   0.2\n 1   4\t0.3\n",
    "blanks and units": "time [s]  F [N]  x [m]\n0 1 0.1\n0.5 2 0.2\n1 4 0.3\n",
    "byte order mark": "\ufefftime,F,x\n0,1,0.1\n0.5,2,0.2\n1,4,0.3\n",
    "units in the header": "time [ms],F [kN],x (cm)\n0,0.001,10\n500,0.002,20\n1000,0.004,30\n",
    "a line of units": "time,F,x\nms,kN,cm\n0,0.001,10\n500,0.002,20\n1000,0.004,30\n",
    "a line of units in brackets": "time,F,x\n[s],[N],[m]\n0,1,0.1\n0.5,2,0.2\n1,4,0.3\n",
    "a line of some units": "time,F,x\ns,,mm\n0,1,100\n0.5,2,200\n1,4,300\n",
    "other columns with text": "time,F,x,who\n0,1,0.1,a\n0.5,2,0.2,b\n1,4,0.3,c\n",
    "dates": "time,F,x\n2026-11-22 17:00:00,1,0.1\n2026-11-22 17:00:00.5,2,0.2\n"
    "2026-11-22 17:00:01.000,4,0.3\n",
    "dates of ISO 8601": "time,F,x\n2026-12-31T23:59:59.5Z,1,0.1\n2027-01-01T01:00:00+01:00,2,0.2\n"
    "2026-12-31T19:00:00.5-0500,4,0.3\n",
}


@pytest.mark.parametrize("case", GOOD)
def test_it_is_read(case: str, tmp_path: Path) -> None:
    np.testing.assert_allclose(output(read(tmp_path, GOOD[case])), PLAIN, rtol=1e-15)


def test_times_are_seconds_from_the_first_row(tmp_path: Path) -> None:
    (run,) = read(tmp_path, GOOD["dates of ISO 8601"])
    assert run.places.time.tolist() == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("word", ["", "NA", "N/A", "#N/A", "NaN", "null", "-"])
def test_words_for_nothing_are_missing_values(tmp_path: Path, word: str) -> None:
    text = f"time,F,x\n0,1,0.1\n0.5,{word},0.2\n1,4,0.3\n1.5,4,0.3\n"
    with pytest.raises(SpecError) as caught:
        read(tmp_path, text)
    assert [found.code for found in caught.value.diagnostics] == ["E0809"]
    first, second = read(tmp_path, text, nan="split")
    assert (first.steps, second.steps) == (1, 2)


def test_a_row_of_words_for_nothing_is_a_row(tmp_path: Path) -> None:
    text = "x,F\n-,-\n0.1,1\n0.2,2\n"
    spec = SPEC.replace("  time: time\n", "  nan: split\n")
    (run,) = read(tmp_path, text, spec=spec)
    assert run.places.rows.tolist() == [1, 2]


def test_decimal_commas_need_their_key_and_then_are_numbers(tmp_path: Path) -> None:
    text = "time;F;x\n0;1;0,1\n0,5;2;0,2\n1;4;0,3\n"
    with pytest.raises(SpecError, match="E0808"):
        read(tmp_path, text)
    np.testing.assert_allclose(output(read(tmp_path, text, csv={"decimal": ","})), PLAIN)


def test_points_that_may_part_thousands_are_asked_for(tmp_path: Path) -> None:
    text = "time;F;x\n0;1;0,1\n0,5;2.000;0,2\n1;4;0.3\n"
    with pytest.raises(SpecError) as caught:
        read(tmp_path, text, csv={"decimal": ","})
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0807"
    assert "`2000` or `2,000`" in str(fault.help)
    plain = text.replace("2.000", "2")
    np.testing.assert_allclose(output(read(tmp_path, plain, csv={"decimal": ","})), PLAIN)


def test_both_spellings_of_a_header_find_a_column(tmp_path: Path) -> None:
    text = GOOD["units in the header"]
    columns = {"F": "F [kN]", "x": "x"}
    np.testing.assert_allclose(output(read(tmp_path, text, columns=columns)), PLAIN)
    said = {"F": {"column": "F", "unit": "N"}}
    assert output(read(tmp_path, text, columns=said))[0] == pytest.approx(0.101)


@pytest.mark.parametrize("name", ["x[1]", "f(x)", "x (filtered)", "x [0]"])
def test_what_is_no_unit_stays_in_the_name(tmp_path: Path, name: str) -> None:
    text = f"time,F,{name}\n0,1,0.1\n0.5,2,0.2\n1,4,0.3\n"
    assert output(read(tmp_path, text, columns={"x": name})) == PLAIN.tolist()


REFUSED: dict[str, tuple[str, dict[str, Any], str]] = {
    "another delimiter than the spec says": (
        GOOD["semicolons"],
        {"csv": {"delimiter": ","}},
        "E0805",
    ),
    "a word among dates": (
        GOOD["dates"] + "later,5,0.4\n",
        {},
        "E0989",
    ),
    "a number among dates": (GOOD["dates"] + "1.5,5,0.4\n", {}, "E0989"),
    "a date that is none": (GOOD["dates"] + "2026-02-30 00:00:00,5,0.4\n", {}, "E0989"),
    "days of a country": ("time,F,x\n22.11.2026,1,0.1\n", {}, "E0807"),
    "zones of some": (
        "time,F,x\n2026-11-22 17:00:00Z,1,0.1\n2026-11-22 17:00:00.5,2,0.2\n",
        {},
        "E0990",
    ),
    "two units": ("time,F [N],x\ns,kN,m\n0,1,0.1\n", {}, "E0991"),
    "a unit and a factor": (
        GOOD["units in the header"],
        {"columns": {"F": {"column": "F", "scale": 1000}}},
        "E0997",
    ),
    "a unit of dates": (GOOD["dates"], {"time": {"column": "time", "unit": "ms"}}, "E0998"),
    "another dimension": (GOOD["semicolons"].replace("x", "x (t)", 1), {}, "E0999"),
    "time that is none": (GOOD["semicolons"].replace("time", "time [m]", 1), {}, "E0999"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_clear_is_asked(case: str, tmp_path: Path) -> None:
    text, layout, code = REFUSED[case]
    with pytest.raises(SpecError) as caught:
        read(tmp_path, text, **layout)
    assert {found.code for found in caught.value.diagnostics} == {code}


def test_a_factor_beside_the_unit_of_the_signal_is_clear(tmp_path: Path) -> None:
    text = "time,F [N],x [m]\n0,0.1,0.1\n0.5,0.2,0.2\n1,0.4,0.3\n"
    found = read(tmp_path, text, columns={"F": {"column": "F", "scale": 10}})
    np.testing.assert_allclose(output(found), PLAIN)


def test_dated_files_that_follow_each_other_are_joined(tmp_path: Path) -> None:
    head = "time,F,x\n"
    (tmp_path / "a.csv").write_text(f"{head}2026-11-22 17:00,1,0.1\n2026-11-22 17:00:00.5,2,0.2\n")
    (tmp_path / "b.csv").write_text(f"{head}2026-11-22 17:00:01,4,0.3\n2026-11-22 17:00:01.5,4,3\n")
    (run,) = simulated(tmp_path, "[a.csv, b.csv]", join=True)
    assert run.steps == 4
    apart = simulated(tmp_path, "[a.csv, b.csv]")
    assert [each.steps for each in apart] == [2, 2]


@pytest.mark.parametrize("begins", ["2026-11-22 17:00:01Z,4,0.3", "0.5,4,0.3"])
def test_times_that_do_not_compare_join_no_files(tmp_path: Path, begins: str) -> None:
    head = "time,F,x\n"
    (tmp_path / "a.csv").write_text(f"{head}2026-11-22 17:00,1,0.1\n2026-11-22 17:00:00.5,2,0.2\n")
    (tmp_path / "b.csv").write_text(f"{head}{begins}\n")
    assert [each.steps for each in simulated(tmp_path, "[a.csv, b.csv]", join=True)] == [2, 1]


@pytest.mark.parametrize("moment", ["9999-11-22 17:00:00Z", "0001-01-01", "2026-11-22 17:00+25:00"])
def test_moments_that_are_none_or_out_of_reach_are_said(tmp_path: Path, moment: str) -> None:
    with pytest.raises(SpecError) as caught:
        read(tmp_path, f"time,F,x\n{moment},1,0.1\n{moment},2,0.2\n")
    assert {found.code for found in caught.value.diagnostics} == {"E0807"}


def _workbook(folder: Path, rows: Sequence[Sequence[object]]) -> str:
    book = openpyxl.Workbook()
    sheet: Any = book.active
    for row in rows:
        sheet.append(list(row))
    book.create_sheet("notes").append(["nothing"])
    book.save(folder / "log.xlsx")
    return "log.xlsx"


def test_a_workbook_is_read_by_its_first_sheet(tmp_path: Path) -> None:
    times = [datetime(2026, 11, 22, 17, 0, 0, 500_000 * k) for k in (0, 1)]
    times.append(datetime(2026, 11, 22, 17, 0, 1))
    rows: list[Sequence[object]] = [["time", "F [kN]", "x", "who"], ["", "", "cm", ""]]
    rows += [[t, f / 1000, 100 * x, "me"] for t, f, x in zip(times, FORCE, PLACE, strict=True)]
    name = _workbook(tmp_path, rows)
    np.testing.assert_allclose(output(simulated(tmp_path, name)), PLAIN, rtol=1e-15)


def test_a_workbook_that_states_too_small_a_size_is_read_whole(tmp_path: Path) -> None:
    """Exporters write sizes that are wrong; rows of fewer cells are as wide as the others."""
    rows = [["time", "F", "x", "note"], [0, 1, 0.1], [0.5, 2, 0.2], [1, 4, 0.3]]
    whole = tmp_path / _workbook(tmp_path, rows)
    with zipfile.ZipFile(whole) as book:
        texts = {name: book.read(name) for name in book.namelist()}
    sheet = texts["xl/worksheets/sheet1.xml"]
    texts["xl/worksheets/sheet1.xml"] = sheet.replace(b'ref="A1:D4"', b'ref="A1:C3"', 1)
    assert texts["xl/worksheets/sheet1.xml"] != sheet
    with zipfile.ZipFile(tmp_path / "small.xlsx", "w") as book:
        for name, text in texts.items():
            book.writestr(name, text)
    np.testing.assert_array_equal(output(simulated(tmp_path, "small.xlsx")), PLAIN)


def test_a_fault_in_a_workbook_names_its_row(tmp_path: Path) -> None:
    name = _workbook(tmp_path, [["time", "F", "x"], [0, 1, 0.1], [0.5, "much", 0.2]])
    with pytest.raises(SpecError, match="`much` in column `F` is not a number") as caught:
        simulated(tmp_path, name)
    (found,) = caught.value.diagnostics
    assert found.span is not None
    assert found.span.line == 3


@pytest.mark.parametrize("column", [1, 2, 0])
def test_formulas_that_nobody_has_computed_are_no_empty_cells(tmp_path: Path, column: int) -> None:
    """Those of a target, which may be missing, would else count as not measured."""
    rows: list[list[object]] = [["time", "u", "y"], [0, 1, 2], [0.5, 1, 2], [1, 1, 2]]
    rows[2][column] = "=B2*0.5"
    spec = SPEC.replace("{F: {unit: N}, x: {unit: m}}", "{u: {}}\ntargets: {y: {}}")
    spec = spec.replace("constants: {softness: 1 m/N}\n", "").replace(
        "y: {expr: F * softness + x, unit: m}", 'out: {expr: 2 * u, predicts: "y[t]"}'
    )
    with pytest.raises(SpecError, match=r"`=B2\*0\.5` in column") as caught:
        simulated(tmp_path, _workbook(tmp_path, rows), spec=spec)
    (found,) = caught.value.diagnostics
    assert (found.code, found.span and found.span.line) == ("E0807", 3)
    assert "save it" in (found.help or "")


def test_computed_formulas_and_empty_cells_of_a_workbook_are_read_as_before(tmp_path: Path) -> None:
    rows: list[Sequence[object]] = [["time", "F", "x", "n"], [0, 1, 0.1, "=1+1"], [0.5, 2, 0.2]]
    rows += [[1, 4, 0.3, "=2"]]
    whole = tmp_path / _workbook(tmp_path, rows)
    with zipfile.ZipFile(whole) as book:
        texts = {name: book.read(name) for name in book.namelist()}
    sheet = texts["xl/worksheets/sheet1.xml"].decode()
    # as a spreadsheet program saves `=""`, and `=2*2` in the place of the number 4
    sheet = sheet.replace('<c r="B4" t="n"><v>4</v></c>', '<c r="B4"><f>2*2</f><v>4</v></c>')
    assert "2*2" in sheet
    texts["xl/worksheets/sheet1.xml"] = sheet.encode()
    with zipfile.ZipFile(tmp_path / "saved.xlsx", "w") as book:
        for name, text in texts.items():
            book.writestr(name, text)
    np.testing.assert_array_equal(output(simulated(tmp_path, "saved.xlsx")), PLAIN)


def test_a_workbook_asks_for_what_reads_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = _workbook(tmp_path, [["time", "F", "x"], [0, 1, 0.1]])
    missing = OptionalPackage("no_such_openpyxl", OPENPYXL.extra, OPENPYXL.purpose)
    excel = replace(table_of_formats.format_of(name), packages=(missing,))
    monkeypatch.setattr(table_of_formats, "FORMATS", (excel,))
    with pytest.raises(msnn.MissingExtraError, match="reads Excel files"):
        simulated(tmp_path, name)


def test_a_broken_workbook_says_so(tmp_path: Path) -> None:
    (tmp_path / "log.xlsx").write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(SpecError, match="not a workbook that can be read"):
        simulated(tmp_path, "log.xlsx")


def test_serial_dates_of_spreadsheets_are_refused_with_the_reason(tmp_path: Path) -> None:
    rows = "".join(f"{46348.5 + 0.5 * k / 86400:.9f},1,0.1\n" for k in range(4))
    with pytest.raises(SpecError) as caught:
        read(tmp_path, f"time,F,x\n{rows}")
    (found,) = caught.value.diagnostics
    assert found.code == "E0812"
    assert "`time: {column: time, unit: d}`, or format serial dates" in (found.help or "")


def test_frames_have_dates_too(tmp_path: Path) -> None:
    model = msnn.load(SPEC.replace("FILE", "none.csv"))
    time = pd.date_range("2026-11-22 17:00", periods=3, freq="500ms")
    frame = pd.DataFrame({"time": time, "F": FORCE, "x": PLACE})
    assert output(msnn.simulate(model, frame)) == PLAIN.tolist()


MINUTES = "time,F,x\n" + "".join(f"2026-11-22 17:{m:02}:00.000,{m},0\n" for m in range(10))
BY_MINUTES = SPEC.replace("0.5 s", "1 min")


@pytest.mark.parametrize(
    ("layout", "expected"),
    [
        ({"from": "2026-11-22 17:06"}, [6.0, 7.0, 8.0, 9.0]),
        ({"from": "2026-11-22T17:02:00", "to": "2026-11-22 17:04"}, [2.0, 3.0, 4.0]),
        ({"from": "7 min", "to": "2026-11-22 17:08:59.9"}, [7.0, 8.0]),
        ({"to": "2026-11-22 17:01"}, [0.0, 1.0]),
    ],
)
def test_rows_are_picked_by_dates(
    tmp_path: Path, layout: dict[str, str], expected: list[float]
) -> None:
    assert output(read(tmp_path, MINUTES, spec=BY_MINUTES, **layout)) == expected


def test_dates_of_another_zone_are_the_same_moments(tmp_path: Path) -> None:
    text = MINUTES.replace(".000,", "+01:00,")
    found = read(tmp_path, text, spec=BY_MINUTES, **{"from": "2026-11-22T16:08:00Z"})
    assert output(found) == [8.0, 9.0]


@pytest.mark.parametrize(
    ("text", "layout", "code"),
    [
        ("time,F,x\n0,1,0\n60,2,0\n", {"from": "2026-11-22"}, "E0979"),
        (MINUTES, {"to": "2026-11-22 17:04Z"}, "E0979"),
        (MINUTES.replace(".000,", "Z,"), {"to": "2026-11-22 17:04"}, "E0979"),
        (
            MINUTES,
            {"split": {"by": "time", "val": ["2026-11-22 17:04Z", "2026-11-22 17:05Z"]}},
            "E0979",
        ),
        (MINUTES, {"from": "2026-11-22 18:00"}, "E0818"),
        (MINUTES, {"from": "22.11.2026"}, "E0216"),
        (
            MINUTES,
            {"split": {"by": "time", "val": ["2026-11-22 17:05", "2026-11-22 17:04"]}},
            "E0223",
        ),
        (MINUTES, {"split": {"by": "time", "val": ["60 s", "2026-11-22 17:04"]}}, "E0223"),
        (
            MINUTES,
            {
                "split": {
                    "by": "time",
                    "val": ["60 s", "80 s"],
                    "test": ["2026-11-22 17:04", "2026-11-22 17:05"],
                }
            },
            "E0223",
        ),
    ],
)
def test_dates_that_do_not_compare_are_refused(
    tmp_path: Path, text: str, layout: dict[str, Any], code: str
) -> None:
    with pytest.raises(SpecError) as caught:
        read(tmp_path, text, spec=BY_MINUTES, **layout)
    assert {found.code for found in caught.value.diagnostics} == {code}


@pytest.mark.parametrize(
    ("text", "date"),
    [
        (MINUTES, "2026-11-22 17:04Z"),
        (MINUTES, "2026-11-22T17:04:00.5+01:00"),
        (MINUTES, "2026-11-22 17:04 -0130"),
        (MINUTES.replace(".000,", "Z,"), "2026-11-22 17:04"),
        # a day alone takes no offset
        (MINUTES.replace(".000,", "Z,"), "2026-11-22"),
        (MINUTES.replace(".000,", "+01:00,"), "2026-11-22"),
        ("time,F,x\n0,1,0\n60,2,0\n", "2026-11-22"),
    ],
)
def test_the_date_that_is_advised_is_read(tmp_path: Path, text: str, date: str) -> None:
    with pytest.raises(SpecError) as caught:
        read(tmp_path, text, spec=BY_MINUTES, **{"from": date})
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0979"
    advised = str(fault.help).split("`")[-2]
    assert len(output(read(tmp_path, text, spec=BY_MINUTES, **{"from": advised}))) > 0


@pytest.mark.parametrize(
    "cells",
    [
        ("0", "0.5", ""),
        ("", "0.5", "1"),
        ("0", "0.5", "nan"),
        ("2026-11-22 17:00", "2026-11-22 17:00:00.5", "NA"),
    ],
)
@pytest.mark.parametrize("nan", ["error", "split", "drop"])
def test_a_time_that_is_missing_is_told_how_to_mend(
    tmp_path: Path, cells: tuple[str, ...], nan: str
) -> None:
    """`nan:` says nothing of times, so that it is no advice."""
    rows = [f"{cell},{i},{i}\n" for i, cell in enumerate(cells)]
    text = "".join(["time,F,x\n", *rows])
    with pytest.raises(SpecError) as caught:
        read(tmp_path, text, nan=nan)
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0809"
    assert "`nan:" not in str(fault.help)
    # the advice: without these rows, or without `time:`
    kept = [row for row, cell in zip(rows, cells, strict=True) if cell not in ("", "nan", "NA")]
    assert len(output(read(tmp_path, "".join(["time,F,x\n", *kept]), nan=nan))) == 2
    untimed = SPEC.replace("  time: time\n", "")
    assert len(output(read(tmp_path, text, spec=untimed, nan=nan))) == 3


@pytest.mark.parametrize("kind", ["a.npz", "a.parquet"])
def test_a_time_that_arrays_lack_is_told_how_to_mend(tmp_path: Path, kind: str) -> None:
    columns = {"time": [0, np.nan, 1.0], "F": [1.0, 2, 3], "x": [1.0, 2, 3]}
    if kind == "a.npz":
        np.savez(tmp_path / kind, time=columns["time"], F=columns["F"], x=columns["x"])
    else:
        pd.DataFrame(columns).to_parquet(tmp_path / kind)
    with pytest.raises(SpecError) as caught:
        simulated(tmp_path, kind)
    assert "remove `time:`" in str(caught.value.diagnostics[0].help)


@pytest.mark.parametrize("resample", [None, "linear"])
def test_a_clock_that_is_set_back_by_an_hour_asks_for_offsets(
    tmp_path: Path, resample: str | None
) -> None:
    """Sorted by the clock, the rows of both hours from 2 to 3 would be mixed."""
    hours = [("02:20", "02:00"), ("02:40", "02:00"), ("02:00", "01:00"), ("02:20", "01:00")]
    rows = [f"2026-10-25 {clock}+{offset},{i},{i}" for i, (clock, offset) in enumerate(hours)]
    local = [row.replace("+02:00", "").replace("+01:00", "") for row in rows]
    spec = SPEC.replace("0.5 s", "20 min")
    more = {} if resample is None else {"resample": resample}
    with pytest.raises(SpecError, match="E0813") as caught:
        read(tmp_path, "\n".join(["time,F,x", *local]), spec=spec, **more)
    assert "offset from UTC" in str(caught.value.diagnostics[0].help)
    found = read(tmp_path, "\n".join(["time,F,x", *rows]), spec=spec, **more)
    assert output(found) == [0, 2, 4, 6]


@pytest.mark.parametrize(
    ("times", "layout", "rows"),
    [
        # two recordings in one file: sorted, their rows would be mixed
        ((0, 0.5, 1, 0, 0.5, 1), {"resample": "none"}, [3, 3]),
        # printed with too few digits, of 0, 0.5, 1, …: of each pair one would be lost
        ((0, 0, 1, 1, 2, 2), {"time": None}, [6]),
    ],
)
def test_rows_that_do_not_rise_are_kept_by_the_advice(
    tmp_path: Path, times: tuple[float, ...], layout: dict[str, Any], rows: list[int]
) -> None:
    lines = [f"{time},{row},0\n" for row, time in enumerate(times)]
    text = "".join(["time,F,x\n", *lines])
    with pytest.raises(SpecError) as caught:
        read(tmp_path, text)
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0813"
    assert ("`resample: none`" if "resample" in layout else "remove `time:`") in str(fault.help)
    spec = SPEC.replace("  time: time\n", "") if "time" in layout else SPEC
    kept = {key: value for key, value in layout.items() if value is not None}
    runs = read(tmp_path, text, spec=spec, **kept)
    assert [len(run.outputs["y"]) for run in runs] == rows


def test_a_choice_of_rows_by_times_that_occur_twice_is_advised_rows(tmp_path: Path) -> None:
    lines = [f"{time},{row},0\n" for row, time in enumerate((0, 0.5, 1, 0, 0.5, 1))]
    text = "".join(["time,F,x\n", *lines])
    with pytest.raises(SpecError) as caught:
        read(tmp_path, text, resample="none", **{"from": "0.5 s"})
    assert caught.value.diagnostics[0].code == "E0813"
    assert "numbers of rows" in str(caught.value.diagnostics[0].help)
    advised: dict[str, Any] = {"resample": "none", "from": 1}
    runs = read(tmp_path, text, **advised)
    assert [len(run.outputs["y"]) for run in runs] == [2, 3]


BEGINNINGS = {
    "gzip": (b"\x1f\x8b\x08\x00", "gzip -dc log.csv > unpacked.csv"),
    "bzip2": (b"BZh91AY", "bzip2 -dc log.csv"),
    "xz": (b"\xfd7zXZ\x00\x00", "xz -dc log.csv"),
    "zstd": (b"\x28\xb5\x2f\xfd\x04", "zstd -dc log.csv"),
    "HDF5": (b"\x89HDF\r\n\x1a\n\x00", "`.h5`"),
    "Parquet": (b"PAR1\x15\x04", "`.parquet`"),
    "MAT": (b"MATLAB 5.0 MAT-file", "`.mat`"),
    "MDF": (b"MDF     4.10    ", "`.mf4`"),
    "ROS bag": (b"#ROSBAG V2.0\n", "`.bag`"),
    "TDMS": (b"TDSm\x0e\x00\x00\x00", "`.tdms`"),
    "ULog": (b"ULog\x01\x12\x35\x01", "`.ulg`"),
    "NPY": (b"\x93NUMPY\x01\x00", "numpy.savez"),
    "Feather": (b"ARROW1\x00\x00", "Parquet"),
    "NetCDF 3": (b"CDF\x01\x00", "nccopy"),
}


@pytest.mark.parametrize("kind", BEGINNINGS)
def test_a_file_that_is_no_text_is_told_what_it_is(tmp_path: Path, kind: str) -> None:
    """`iconv` makes no table of it."""
    begin, repair = BEGINNINGS[kind]
    (tmp_path / "log.csv").write_bytes(begin + bytes(range(256)))
    with pytest.raises(SpecError) as caught:
        simulated(tmp_path, "log.csv")
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0802"
    assert kind in fault.message
    assert repair in str(fault.help)
    assert "iconv" not in str(fault.help)


@pytest.mark.parametrize("suffix", [".gz", ""])
def test_a_compressed_table_is_read_after_the_advice(tmp_path: Path, suffix: str) -> None:
    name = f"log.csv{suffix}"
    (tmp_path / name).write_bytes(gzip.compress(GOOD["byte order mark"].encode()))
    with pytest.raises(SpecError) as caught:
        simulated(tmp_path, name)
    command = str(caught.value.diagnostics[0].help).split("`")[1]
    subprocess.run(["sh", "-c", command], cwd=tmp_path, check=True)
    assert output(simulated(tmp_path, "unpacked.csv")) == PLAIN.tolist()


@pytest.mark.parametrize("member", ["log.csv", "F.npy", "xl/workbook.xml", "content.xml"])
def test_archives_are_told_apart(tmp_path: Path, member: str) -> None:
    with zipfile.ZipFile(tmp_path / "log.csv", "w") as archive:
        archive.writestr(member, "")
    with pytest.raises(SpecError) as caught:
        simulated(tmp_path, "log.csv")
    (fault,) = caught.value.diagnostics
    shown = {"log.csv": "unzip log.csv", "F.npy": "`.npz`"}.get(member, "`….xlsx`")
    assert shown in str(fault.help)


@pytest.mark.parametrize(
    "header", ["x [deg C]", "x [J/(kg K)]", "x (deg C)", "x [furlong per hour]", "x"]
)
@pytest.mark.parametrize("column", ["x", "header"])
def test_a_lone_column_is_not_split_at_the_blanks_of_its_unit(
    tmp_path: Path, header: str, column: str
) -> None:
    unit = "K" if "deg" in header else "J/kg/K" if "kg" in header else "m"
    spec = f"""\
msnn: 1
name: plant
sample_time: 0.5 s
inputs: {{x: {unit}}}
outputs: {{y: x}}
data:
  source: {{train: FILE}}
  columns: {{x: "{header if column == "header" or "furlong" in header else "x"}"}}
"""
    found = output(read(tmp_path, f"{header}\n1\n2\n4\n", spec=spec))
    shift = 273.15 if "deg" in header else 0
    assert found == pytest.approx([1 + shift, 2 + shift, 4 + shift])


@pytest.mark.parametrize(
    "head",
    [
        "time,F,x (J/(kg K))",
        "time,F,x\n,N,J/(kg K)",
        "time,F,x\ns,[N],[J/(kg*K)]",
        "time,F,x\n(s),(N),(kJ/(kg K))",
    ],
)
def test_units_with_parentheses_are_read_in_every_place(tmp_path: Path, head: str) -> None:
    spec = SPEC.replace("x: {unit: m}", "x: {unit: J/kg/K}").replace("m/N", "J/kg/K/N")
    spec = spec.replace("unit: m}", "unit: J/kg/K}")
    found = output(read(tmp_path, f"{head}\n0,1,0.1\n0.5,2,0.2\n1,4,0.3\n", spec=spec))
    times = 1000 if "kJ" in head else 1
    assert found == pytest.approx(np.array(FORCE) + times * np.array(PLACE))


def test_a_header_between_blanks_has_units_with_blanks(tmp_path: Path) -> None:
    text = "time [s]  F [N]  x [J/(kg K)]  T [deg C]\n0 1 0.1 3\n0.5 2 0.2 3\n1 4 0.3 3\n"
    spec = SPEC.replace("x: {unit: m}", "x: {unit: J/kg/K}").replace("m/N", "J/kg/K/N")
    spec = spec.replace("unit: m}", "unit: J/kg/K}")
    assert output(read(tmp_path, text, spec=spec)) == PLAIN.tolist()
