"""Rule R10: splits by time and by fold, and records that go on in the next file."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.data.dataset import Dataset
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from tests.data.specs import load, table


def episodes(data: Dataset, name: str) -> list[list[int]]:
    return data.episodes(name).tolist()


def test_split_by_time_cuts_at_moments(tmp_path: Path) -> None:
    section = "source: {train: a.csv}\nsplit: {by: time, val: [0.4 s, 1 s], test: [1.6 s, 9 s]}\n"
    data = load(tmp_path, section + "time: time\n", {"a.csv": table(10)})
    assert episodes(data, "train") == [[0, 2], [5, 8]]
    assert episodes(data, "val") == [[2, 5]]
    assert episodes(data, "test") == [[8, 10]]
    without_column = load(tmp_path, section)
    assert episodes(without_column, "val") == [[2, 5]]


def test_split_by_time_takes_dates(tmp_path: Path) -> None:
    ranges = "val: [2026-11-22 17:02, 2026-11-22T17:05], test: [2026-11-22 17:08, 2026-11-23]"
    section = f"source: {{train: a.csv}}\nsplit: {{by: time, {ranges}}}\ntime: date\n"
    numbers = [line.split(",", 1)[1] for line in table(10).splitlines()]
    dates = ["date", *(f"2026-11-22 17:0{minute}:00" for minute in range(10))]
    text = "".join(f"{d},{n}\n" for d, n in zip(dates, numbers, strict=True))
    data = load(tmp_path, section + "resample: none\n", {"a.csv": text})
    assert data.set_of_row.tolist() == [0, 0, 1, 1, 1, 0, 0, 0, 2, 2]


def told(data: Dataset) -> list[Diagnostic]:
    """The warnings of sets; numbers of rows are beyond the range of `x`."""
    return [warning for warning in data.warnings if warning.code != "W0801"]


def test_blocks_that_end_between_rows_differ_by_one_row(tmp_path: Path) -> None:
    """Blocks of 2.5 rows end at 2.5, 5, 7.5, 10: halves upwards 3, 2, 3 and 2 rows each."""
    section = "source: {train: a.csv}\nsplit: {by: block, blocks: 4, val: [2], test: [3]}\n"
    data = load(tmp_path, section, {"a.csv": table(10)})
    assert data.set_of_row.tolist() == [0, 0, 0, 1, 1, 2, 2, 2, 0, 0]


def test_rows_outside_all_ranges_belong_to_no_set(tmp_path: Path) -> None:
    section = "source: {train: a.csv}\nsplit: {by: time, train: [0 s, 0.6 s], val: [1 s, 1.4 s]}\n"
    data = load(tmp_path, section, {"a.csv": table(10)})
    assert episodes(data, "train") == [[0, 3]]
    assert episodes(data, "val") == [[5, 7]]


@pytest.mark.parametrize("fold", [1, 2, 3])
def test_each_fold_of_blocks_is_val_once(tmp_path: Path, fold: int) -> None:
    section = f"source: {{train: a.csv}}\nsplit: {{by: kfold, k: 3, fold: {fold}}}\n"
    data = load(tmp_path, section, {"a.csv": table(9)})
    first = 3 * (fold - 1)
    assert episodes(data, "val") == [[first, first + 3]]
    trained = [[0, first]] if first else []
    assert episodes(data, "train") == trained + ([[first + 3, 9]] if fold < 3 else [])


def test_folds_are_files_where_there_are_enough(tmp_path: Path) -> None:
    files = {f"{name}.csv": table(4) for name in "abcde"}
    held_out: list[list[int]] = []
    for fold in (1, 2):
        section = f"source: {{train: '*.csv'}}\nsplit: {{by: kfold, k: 2, fold: {fold}}}\n"
        held_out += episodes(load(tmp_path, section, files), "val")
    assert held_out == [[0, 4], [4, 8], [8, 12], [12, 16], [16, 20]]


def test_files_that_follow_in_time_are_one_record(tmp_path: Path) -> None:
    lines = table(10).splitlines()
    files = {
        "log_1.csv": "\n".join(lines[:5]) + "\n",
        "log_2.csv": "\n".join([lines[0], *lines[5:9]]) + "\n",
        "log_3.csv": table(3),
    }
    section = "source: {train: {files: 'log_*.csv', join: true}}\ntime: time\n"
    data = load(tmp_path, section, files)
    assert episodes(data, "train") == [[0, 8], [8, 11]]
    assert [record.file for record in data.records] == ["log_1.csv … log_2.csv", "log_3.csv"]
    apart = load(tmp_path, section.replace("true", "false"))
    assert episodes(apart, "train") == [[0, 4], [4, 8], [8, 11]]


@pytest.mark.parametrize(
    "split",
    [
        "{by: time, val: 0.3}",
        "{by: time, val: [1, 2]}",
        "{by: time, val: [2 s, 1 s]}",
        "{by: time, val: [0 s, 1 s, 2 s]}",
        "{by: time, val: [0 s, 2 s], test: [1 s, 3 s]}",
        "{by: block, blocks: 4, val: [0 s, 1 s]}",
        "{by: kfold}",
        "{by: kfold, k: 1}",
        "{by: kfold, k: 3, fold: 4}",
        "{by: kfold, k: 3, val: 0.5}",
        "{by: file, k: 3, val: 0.5}",
    ],
)
def test_splits_that_do_not_fit(tmp_path: Path, split: str) -> None:
    with pytest.raises(SpecError, match="E0223"):
        load(tmp_path, f"source: {{train: a.csv}}\nsplit: {split}\n", {"a.csv": table(9)})


@pytest.mark.parametrize("count", [10, 100_000])
def test_more_folds_than_rows_are_refused(tmp_path: Path, count: int) -> None:
    """Most of them would hold out nothing."""
    files = {"a.csv": table(9), "b.csv": table(5)}
    section = "source: {train: '*.csv'}\nsplit: {by: kfold, k: COUNT, fold: FOLD}\n"
    for fold in range(1, 10):
        most = section.replace("COUNT", "9").replace("FOLD", str(fold))
        assert episodes(load(tmp_path, most, files), "val")
    with pytest.raises(SpecError, match="E0819") as caught:
        load(tmp_path, section.replace("COUNT", str(count)).replace("FOLD", "1"), files)
    assert caught.value.diagnostics[0].help == "write `k: 9` or less"


@pytest.mark.parametrize(
    ("split", "covered"),
    [
        ("{by: time, val: [60 s, 80 s]}", ": the data are from 0 s to 1.6 s"),
        ("{by: time, val: [0 s, 1 s], test: [1.65 s, 2 s]}", ": the data are from 0 s to 1.6 s"),
        ("{by: fraction, val: 0.05}", ""),
    ],
)
def test_a_set_that_gets_no_row_is_told(tmp_path: Path, split: str, covered: str) -> None:
    section = f"source: {{train: a.csv}}\ntime: time\nsplit: {split}\n"
    data = load(tmp_path, section, {"a.csv": table(9)})
    (said,) = told(data)
    name = "test" if "test" in split else "val"
    assert (said.code, said.message) == ("W0833", f"`split: {name}` has no rows{covered}")
    assert said.span is not None


@pytest.mark.parametrize(
    ("val", "outside"),
    [
        ("41 s, 60 s", "18.4 s after"),
        ("10 s, 41 s", "30 s before"),
        ("10 s, 60 s", "30 s before and 18.4 s after"),
        ("41 s, 42 s", "400 ms after"),
        # the end is not in the range: the last row, at 41.6 s, is followed by none until 41.8 s
        ("40 s, 41.8 s", ""),
        ("39.8 s, 41.6 s", ""),
    ],
)
@pytest.mark.parametrize("how", ["", "resample: linear\n"])
def test_a_range_that_is_partly_outside_of_the_data_is_told(
    tmp_path: Path, val: str, outside: str, how: str
) -> None:
    section = f"source: {{train: '*.csv'}}\ntime: time\n{how}split: {{by: time, val: [{val}]}}\n"
    rows = [f"{40 + 0.2 * k:.1f},{k},0" for k in range(9)]
    # the longest record decides
    files = {f"{n}.csv": "\n".join(["time,x,F", *rows[:n]]) + "\n" for n in (5, 9)}
    data = load(tmp_path, section, files)
    assert data.has("val")
    found = [(said.code, said.severity, said.message) for said in told(data)]
    message = f"`split: val` asks for {outside} the data, which are from 40 s to 41.6 s"
    assert found == ([("W0833", "note", message)] if outside else [])


def test_a_range_beyond_the_rows_without_times_is_told(tmp_path: Path) -> None:
    section = "source: {train: a.csv}\nsplit: {by: time, val: [1 s, 20 s]}\n"
    (said,) = told(load(tmp_path, section, {"a.csv": table(9)}))
    assert (said.code, "18.4 s after the data" in said.message) == ("W0833", True)


@pytest.mark.parametrize("zone", ["", "Z"])
def test_a_range_of_dates_that_is_partly_outside_is_told(tmp_path: Path, zone: str) -> None:
    """Records count from their own first row, dates do not."""
    ranges = f"val: ['2026-11-22 17:02{zone}', '2026-11-22 17:30{zone}']"
    section = f"source: {{train: '*.csv'}}\nsplit: {{by: time, {ranges}}}\ntime: date\n"
    numbers = [line.split(",", 1)[1] for line in table(5).splitlines()[1:]]
    files = {
        f"{first}.csv": "date,F,x\n"
        + "".join(f"2026-11-22 17:{first + k:02}:00{zone},{n}\n" for k, n in enumerate(numbers))
        for first in (10, 20)
    }
    data = load(tmp_path, section + "resample: none\n", files)
    (said,) = told(data)
    assert said.code == "W0833"
    covered = f"2026-11-22 17:10:00{zone} to 2026-11-22 17:24:00{zone}"
    message = "`split: val` asks for 480 s before and 360 s after the data, which are from "
    assert said.message == message + covered


@pytest.mark.parametrize("times", ["", "time: time\n", "time: time\nresample: linear\n"])
@pytest.mark.parametrize("other", ["a.csv", "./a.csv", "sub/../a.csv", "'*.csv'"])
def test_rows_of_a_file_in_two_sets_are_told(tmp_path: Path, times: str, other: str) -> None:
    (tmp_path / "sub").mkdir()
    section = f"source: {{train: a.csv, val: {other}}}\n{times}"
    data = load(tmp_path, section, {"a.csv": table(9)})
    (said,) = told(data)
    assert said.code == "W0834"
    assert "is in the sets `train` and `val`: 9 of its rows are in both" in said.message
    # each its own rows, as the repair says
    apart = "source: {train: {files: a.csv, to: 5}, val: {files: a.csv, from: 6}}\n"
    assert not told(load(tmp_path, apart + times))
    touching = apart.replace("from: 6", "from: 4")
    assert "2 of its rows" in told(load(tmp_path, touching + times))[0].message
