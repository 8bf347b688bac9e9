"""Rule R10: `join: true` makes one recording of files that follow each other, or says why not."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
from asammdf import MDF, Signal
from numpy.typing import NDArray

from msnn.data.dataset import Dataset
from spec_schema.diagnostics.diagnostic import SpecError
from tests.data.specs import load

Values = NDArray[Any]


def write_csv(path: Path, time: Values, x: Values) -> None:
    rows = (f"{t!r},{a!r},{-a!r}" for t, a in zip(time.tolist(), x.tolist(), strict=True))
    path.write_text("time,x,F\n" + "\n".join(rows).replace("nan", "") + "\n")


def write_mdf(path: Path, time: Values, x: Values) -> None:
    with MDF(version="4.10") as file:
        file.append([Signal(x, time, name="x"), Signal(-x, time, name="F")])
        file.save(path, overwrite=True)


WRITERS: dict[str, Callable[[Path, Values, Values], None]] = {
    "csv": write_csv,
    "npz": lambda path, time, x: np.savez(path, time=time, x=x, F=-x),
    "parquet": lambda path, time, x: parquet.write_table(
        arrow.table({"time": time, "x": x, "F": -x}), path
    ),
    "mf4": write_mdf,
}


def cut(folder: Path, kind: str, time: Values, x: Values, cuts: list[int]) -> str:
    """Files a, b, … of the rows between cuts, and the same rows in one, `whole`."""
    edges = [0, *cuts, len(time)]
    for number, (begin, end) in enumerate(pairwise(edges)):
        WRITERS[kind](folder / f"{'abcd'[number]}.{kind}", time[begin:end], x[begin:end])
    WRITERS[kind](folder / f"whole.{kind}", time, x)
    return "" if kind == "mf4" else "time: time\n"


def same(one: Dataset, other: Dataset) -> bool:
    return (
        all(np.array_equal(v, other.series[n], equal_nan=True) for n, v in one.series.items())
        and one.episodes("train").tolist() == other.episodes("train").tolist()
        and len(one.records) == len(other.records) == 1
    )


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("how", ["resample: linear", "resample: nearest"])
def test_resampled_files_have_one_grid(tmp_path: Path, kind: str, how: str) -> None:
    """Rows every 70 ms, cut between two rows of the grid of 200 ms."""
    time = 0.07 * np.arange(60)
    section = cut(tmp_path, kind, time, np.sin(time), [20, 41]) + f"{how}\n"
    parts = f"[a.{kind}, b.{kind}, c.{kind}]"
    joined = load(tmp_path, f"source: {{train: {parts}}}\njoin: true\n{section}")
    assert same(joined, load(tmp_path, f"source: {{train: whole.{kind}}}\n{section}"))
    (record,) = joined.records
    assert [piece.file for piece in record.pieces] == [f"{name}.{kind}" for name in "abc"]
    # each of the grid's rows is in the file that has its time
    assert [(p.start, p.stop) for p in record.pieces] == [(0, 7), (7, 15), (15, 21)]
    assert not joined.warnings


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("order", ["[b, a, c]", "[c, b, a]"])
def test_files_are_joined_in_the_order_of_their_times(
    tmp_path: Path, kind: str, order: str
) -> None:
    """Names sort `log_10` before `log_2`."""
    time = 0.2 * np.arange(12)
    section = cut(tmp_path, kind, time, time, [4, 8])
    parts = order.replace(",", f".{kind},").replace("]", f".{kind}]")
    joined = load(tmp_path, f"source: {{train: {parts}}}\njoin: true\n{section}")
    assert same(joined, load(tmp_path, f"source: {{train: whole.{kind}}}\n{section}"))
    assert [record.file for record in joined.records] == [f"a.{kind} … c.{kind}"]


@pytest.mark.parametrize(
    ("kind", "choice"),
    [
        (kind, choice)
        for choice in (
            "from: 0.3 s\nto: 1.9 s\n",
            "to: 0.5 s\n",
            "from: 1.3 s\n",
            "to: 1.7 s\nresample: linear\n",
            "every: 3\nfrom: 1\n",
            "from: 2\nto: 9\n",
            "split: {by: fraction, val: 0.3}\n",
            "split: {by: time, val: [0.5 s, 1.7 s]}\n",
            "split: {by: block, blocks: 3, val: [2]}\n",
        )
        for kind in WRITERS
        # streams have no rows that could be counted
        if kind != "mf4" or not re.search(r"every|from: \d\n", choice)
    ],
)
def test_keys_count_on_the_joined_recording(tmp_path: Path, kind: str, choice: str) -> None:
    step = 0.2 / 3 if "every" in choice else 0.2
    time = step * np.arange(12)
    section = cut(tmp_path, kind, time, time, [5, 7]) + choice
    parts = f"[a.{kind}, b.{kind}, c.{kind}]"
    joined = load(tmp_path, f"source: {{train: {parts}}}\njoin: true\n{section}")
    whole = load(tmp_path, f"source: {{train: whole.{kind}}}\n{section}")
    assert same(joined, whole)
    np.testing.assert_array_equal(joined.set_of_row, whole.set_of_row)


def test_rows_are_called_by_their_files(tmp_path: Path) -> None:
    time = 0.2 * np.arange(12)
    x = np.array(time)
    x[7] = np.nan
    cut(tmp_path, "csv", time, x, [5])
    section = "source: {train: [a.csv, b.csv]}\njoin: true\ntime: time\n"
    for more in ("", "resample: linear\n"):
        with pytest.raises(SpecError, match="E0809") as caught:
            load(tmp_path, section + more)
        (x_fault, _) = caught.value.diagnostics
        assert "in row 2 of b.csv" in x_fault.message
        assert x_fault.span is not None
        assert (x_fault.span.file, x_fault.span.line) == ("b.csv", 4)
    data = load(tmp_path, section + "nan: split\n")
    assert data.episodes("train").tolist() == [[0, 7], [8, 12]]
    assert data.place(7) == "row 2 of b.csv"
    # a record lacks an input, not one of its files
    time = 0.2 * np.arange(12)
    write_csv(tmp_path / "c.csv", time, time)
    dropped = load(tmp_path, section.replace("b.csv]", "b.csv, c.csv]") + "nan: drop\n")
    assert [record.file for record in dropped.records] == ["c.csv"]
    assert "a.csv … b.csv is left out: an input is missing in row 2 of b.csv" in str(
        [warning.message for warning in dropped.warnings]
    )


@pytest.mark.parametrize("how", ["", "resample: linear\n"])
@pytest.mark.parametrize(
    ("begin", "severity", "reason"),
    [
        (0.0, "warning", "b.csv begins 800 ms before the end of a.csv"),
        (0.6, "warning", "b.csv begins 200 ms before the end of a.csv"),
        (0.8, "warning", "b.csv begins with the time at which a.csv ends"),
        (5.0, "warning", "b.csv begins 4.2 s after the end of a.csv"),
    ],
)
def test_files_that_do_not_follow_are_told(
    tmp_path: Path, how: str, begin: float, severity: str, reason: str
) -> None:
    time = 0.2 * np.arange(5)
    write_csv(tmp_path / "a.csv", time, time)
    write_csv(tmp_path / "b.csv", time + begin, time)
    section = f"source: {{train: [a.csv, b.csv]}}\njoin: true\ntime: time\n{how}"
    data = load(tmp_path, section)
    assert len(data.records) == 2
    (said,) = data.warnings
    assert (said.code, said.severity) == ("W0832", severity)
    assert said.message == f"`join: true` joins no files: {reason}"
    # the repair as it is written
    apart = load(tmp_path, section.replace("join: true", "join: false"))
    assert not apart.warnings
    assert all(np.array_equal(v, data.series[n]) for n, v in apart.series.items())


def test_pauses_between_recordings_are_a_note(tmp_path: Path) -> None:
    time = 0.2 * np.arange(5)
    for name, begin in {"a": 0.0, "b": 1.0, "c": 9.0, "d": 10.0}.items():
        write_csv(tmp_path / f"{name}.csv", time + begin, time)
    data = load(tmp_path, "source: {train: '*.csv'}\njoin: true\ntime: time\n")
    assert [record.file for record in data.records] == ["a.csv … b.csv", "c.csv … d.csv"]
    (said,) = data.warnings
    assert (said.code, said.severity) == ("W0832", "note")
    assert said.message.startswith("`join: true` joins 4 files to 2 recordings: c.csv begins 7.2 s")


def test_files_with_other_units_are_told(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time,x [m],F\n0,1,1\n0.2,2,1\n")
    (tmp_path / "b.csv").write_text("time,x [mm],F\n0.4,3000,1\n0.6,4000,1\n")
    data = load(tmp_path, "source: {train: [a.csv, b.csv]}\njoin: true\ntime: time\n")
    assert data.series["x"].tolist() == [1, 2, 3, 4]
    assert "differ in their units" in data.warnings[0].message


def test_dates_with_and_without_a_zone_are_not_joined(tmp_path: Path) -> None:
    text = "time,x,F\n2026-11-22 17:00:{}{},1,1\n2026-11-22 17:00:{}{},1,1\n"
    (tmp_path / "a.csv").write_text(text.format("00", "", "00.2", ""))
    (tmp_path / "b.csv").write_text(text.format("00.4", "Z", "00.6", "Z"))
    data = load(tmp_path, "source: {train: [a.csv, b.csv]}\njoin: true\ntime: time\n")
    assert "the times of b.csv and a.csv cannot be compared" in data.warnings[0].message
