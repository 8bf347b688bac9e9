"""Rule R10: files to records, rows, sets and episodes, with values in the units of the signals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.data.dataset import Dataset
from spec_schema.diagnostics.diagnostic import SpecError
from tests.data.specs import load, table


def episodes(data: Dataset, name: str) -> list[tuple[int, int]]:
    return [(int(a), int(b)) for a, b in data.episodes(name)]


def test_a_record_is_a_file_and_no_episode_crosses_two(tmp_path: Path) -> None:
    files = {"a.csv": table(4), "b.csv": table(3)}
    data = load(tmp_path, "source: {train: '*.csv'}\ntime: time\n", files)
    assert episodes(data, "train") == [(0, 4), (4, 7)]
    assert [record.file for record in data.records] == ["a.csv", "b.csv"]
    np.testing.assert_array_equal(data.series["x"], [0, 1, 2, 3, 0, 1, 2])


def test_from_and_to_are_inclusive_rows_or_times(tmp_path: Path) -> None:
    files = {"a.csv": table(10)}
    by_row = load(tmp_path, "source: {train: {files: a.csv, from: 2, to: 5}}\n", files)
    np.testing.assert_array_equal(by_row.series["x"], [2, 3, 4, 5])
    section = "source: {train: a.csv}\ntime: time\nfrom: 0.4 s\nto: 1 s\n"
    by_time = load(tmp_path, section)
    np.testing.assert_array_equal(by_time.series["x"], [2, 3, 4, 5])


def test_the_time_may_be_in_another_unit(tmp_path: Path) -> None:
    files = {"a.csv": table(10, step=200)}
    section = "source: {train: a.csv}\ntime: {column: time, unit: ms}\nfrom: 0.4 s\n"
    data = load(tmp_path, section, files)
    assert episodes(data, "train") == [(0, 8)]
    np.testing.assert_array_equal(data.series["x"], np.arange(2, 10))
    with pytest.raises(SpecError, match="E0812"):
        load(tmp_path, "source: {train: a.csv}\ntime: time\n")


def test_times_of_another_unit_are_rounded_once(tmp_path: Path) -> None:
    """100 · 1e-6 is 9.999999999999999e-05."""
    text = "time,x,F\n" + "".join(f"{100 * k},{k},1\n" for k in range(40))
    section = "source: {train: a.csv}\ntime: {column: time, unit: us}\nresample: none\n"
    (record,) = load(tmp_path, section, {"a.csv": text}).records
    (piece,) = record.pieces
    assert piece.time is not None
    assert piece.time.tolist() == [float(f"{k}e-4") for k in range(40)]


def test_every_picks_rows_from_the_first_on(tmp_path: Path) -> None:
    files = {"a.csv": table(11, step=0.05)}
    section = "source: {train: a.csv}\ntime: time\nfrom: 1\nevery: 4\n"
    data = load(tmp_path, section, files)
    np.testing.assert_array_equal(data.series["x"], [1, 5, 9])
    assert data.records[0].place(1) == "row 5 of a.csv"
    assert episodes(data, "train") == [(0, 3)]


def test_a_gap_ends_the_episode_where_asked_for(tmp_path: Path) -> None:
    text = "time,x,F\n0,1,1\n0.2,2,1\n0.6,3,1\n0.8,4,1\n"
    section = "source: {train: a.csv}\ntime: time\nresample: none\n"
    data = load(tmp_path, section, {"a.csv": text})
    assert episodes(data, "train") == [(0, 2), (2, 4)]


def test_a_time_step_may_be_off_by_one_percent(tmp_path: Path) -> None:
    text = "time,x,F\n0,1,1\n0.2019,2,1\n0.4,3,1\n"
    data = load(tmp_path, "source: {train: a.csv}\ntime: time\n", {"a.csv": text})
    assert episodes(data, "train") == [(0, 3)]


def test_a_missing_input_ends_the_episode_with_nan_split(tmp_path: Path) -> None:
    text = "x,F\n1,1\n2,\n3,1\n4,1\n"
    data = load(tmp_path, "source: {train: a.csv}\nnan: split\n", {"a.csv": text})
    assert episodes(data, "train") == [(0, 1), (2, 4)]


def test_nan_drop_leaves_the_record_out_and_says_so(tmp_path: Path) -> None:
    files = {"a.csv": "x,F\n1,1\n2,\n", "b.csv": "x,F\n3,1\n"}
    data = load(tmp_path, "source: {train: '*.csv'}\nnan: drop\n", files)
    np.testing.assert_array_equal(data.series["x"], [3])
    assert [warning.code for warning in data.warnings] == ["W0803"]


def test_column_units_scale_and_offset_convert_once(tmp_path: Path) -> None:
    section = (
        "source: {train: a.csv}\n"
        "columns:\n  x: {column: pos, unit: mm, scale: 2, offset: 100}\n  F: 1\n"
    )
    data = load(tmp_path, section, {"a.csv": "pos,force\n450,7\n"})
    assert data.series["x"][0] == pytest.approx(1.0, rel=1e-15)  # 2·450 + 100 mm
    assert data.series["F"][0] == 7.0


def test_cells_convert_as_numbers_of_a_spec_do(tmp_path: Path) -> None:
    """9 · 0.001 is 0.009000000000000001, which is above a limit of 9 mm."""
    section = "source: {train: a.csv}\ncolumns: {x: {column: pos, unit: mm}, F: 1}\n"
    cells = [f"{number / 10:.1f}" for number in range(1, 1000)]
    text = "pos,force\n" + "".join(f"{cell},0\n" for cell in cells)
    data = load(tmp_path, section, {"a.csv": text})
    assert data.series["x"].tolist() == [float(f"{cell}e-3") for cell in cells]


def test_one_column_may_feed_several_signals(tmp_path: Path) -> None:
    section = "source: {train: a.csv}\ncolumns: {x: v, F: v}\n"
    data = load(tmp_path, section, {"a.csv": "v\n1\n2\n"})
    np.testing.assert_array_equal(data.series["x"], data.series["F"])


def test_blocks_are_cut_at_rounded_parts_of_the_record(tmp_path: Path) -> None:
    section = (
        "source: {train: a.csv}\n"
        "split: {by: block, blocks: 4, train: [1, 3], test: [2], val: [4]}\n"
    )
    data = load(tmp_path, section, {"a.csv": table(10)})
    # round(i·10/4) = 0, 3 (2.5 up), 5, 8 (7.5 up), 10
    assert episodes(data, "train") == [(0, 3), (5, 8)]
    assert episodes(data, "test") == [(3, 5)]
    assert episodes(data, "val") == [(8, 10)]


def test_blocks_that_no_set_names_are_trained_on_unless_train_names_its_own(
    tmp_path: Path,
) -> None:
    files = {"a.csv": table(7)}
    section = "source: {train: a.csv}\nsplit: {by: block, blocks: 7, val: [2], test: [7]"
    data = load(tmp_path, section + "}\n", files)
    assert episodes(data, "train") == [(0, 1), (2, 6)]
    assert episodes(data, "val") == [(1, 2)]
    assert episodes(data, "test") == [(6, 7)]
    named = load(tmp_path, section + ", train: [4]}\n")
    assert episodes(named, "train") == [(3, 4)]


def test_fractions_cut_each_record_in_time(tmp_path: Path) -> None:
    section = "source: {all: '*.csv'}\nsplit: {by: fraction, val: 0.2, test: 0.1}\n"
    data = load(tmp_path, section, {"a.csv": table(10), "b.csv": table(20)})
    assert episodes(data, "train") == [(0, 7), (10, 24)]
    assert episodes(data, "val") == [(7, 9), (24, 28)]
    assert episodes(data, "test") == [(9, 10), (28, 30)]


def test_files_are_shared_out_evenly_and_always_the_same(tmp_path: Path) -> None:
    files = {f"run{i}.csv": table(2) for i in range(10)}
    section = "source: {train: 'run*.csv'}\nsplit: {by: file, val: 0.2}\n"
    data = load(tmp_path, section, files)
    assert len(data.episodes("val")) == 2
    assert len(data.episodes("train")) == 8
    again = load(tmp_path, section)
    np.testing.assert_array_equal(data.set_of_row, again.set_of_row)


def test_stretches_ignore_sets(tmp_path: Path) -> None:
    section = "source: {train: a.csv}\nsplit: {by: block, blocks: 2, train: [1], test: [2]}\n"
    data = load(tmp_path, section, {"a.csv": table(6)})
    assert data.stretches().tolist() == [[0, 6]]


def test_data_outside_the_range_is_a_warning_and_stays(tmp_path: Path) -> None:
    data = load(tmp_path, "source: {train: a.csv}\n", {"a.csv": table(8)})
    assert data.series["x"].max() == 7.0  # the range of x ends at 5
    assert [warning.code for warning in data.warnings] == ["W0801"]
    assert "2 samples of `x`" in data.warnings[0].message
    assert data.warnings[0].message.endswith("the farthest is 7 in row 7 of a.csv")


def test_what_is_out_of_range_is_named_by_its_row_in_its_own_file(tmp_path: Path) -> None:
    files = {"a.csv": table(4), "b.csv": "x,F\n" + "0,0\n" * 5 + "-9,0\n0,0\n0,0\n"}
    section = "source: {train: ['a.csv', 'b.csv']}\nfrom: 2\nevery: 3\n"
    (warning,) = load(tmp_path, section, files).warnings
    assert warning.message.endswith("the farthest is -9 in row 5 of b.csv")


@pytest.mark.parametrize(
    ("section", "code"),
    [
        ("source: {train: nothing/*.csv}\n", "E0801"),
        ("source: {train: a.csv}\nfrom: 1 s\n", "E0823"),
        ("source: {train: a.csv}\nfrom: 10\n", "E0818"),
        ("source: {train: a.csv}\ncolumns: {x: {column: x, unit: kg}}\n", "E0816"),
        ("source: {train: a.csv}\ncolumns: {x: [x, F]}\n", "E0817"),
        ("source: {train: a.csv}\ncolumns: {x: 9}\n", "E0815"),
        ("source: {train: a.csv}\nsplit: {by: file, val: 0.5}\n", "E0819"),
        ("source: {a: a.csv, b: a.csv}\nsplit: {by: fraction, val: 0.5}\n", "E0819"),
    ],
)
def test_faults_of_the_section_have_a_code(tmp_path: Path, section: str, code: str) -> None:
    with pytest.raises(SpecError) as caught:
        load(tmp_path, section, {"a.csv": table(6)})
    assert [diagnostic.code for diagnostic in caught.value.diagnostics] == [code]


def test_decimal_commas_and_other_layouts_are_read(tmp_path: Path) -> None:
    text = "exported by a rig\nx;F\n1,5;-2,25\n"
    section = 'source: {train: a.csv}\ncsv: {delimiter: ";", decimal: ",", skip: 1}\n'
    data = load(tmp_path, section, {"a.csv": text})
    assert (data.series["x"][0], data.series["F"][0]) == (1.5, -2.25)
    bare = load(
        tmp_path,
        "source: {train: b.csv}\ncsv: {header: false}\ncolumns: {x: 1, F: 0}\n",
        {"b.csv": "1,2\n3,4\n"},
    )
    np.testing.assert_array_equal(bare.series["x"], [2, 4])


@pytest.mark.parametrize("target", ["gone.csv", "b.csv"])
def test_a_link_that_leads_nowhere_is_an_error_not_less_data(target: str, tmp_path: Path) -> None:
    (tmp_path / "b.csv").symlink_to(target)
    with pytest.raises(SpecError, match=r"cannot read b\.csv"):
        load(tmp_path, "source: {train: '*.csv'}\n", {"a.csv": table(4)})


def test_a_mistake_of_many_files_is_said_once(tmp_path: Path) -> None:
    files = {f"run{i}.csv": table(3, header="time,x,f") for i in range(10)}
    files["run3.csv"] = table(3, header="time,y,f")
    with pytest.raises(SpecError) as caught:
        load(tmp_path, "source: {train: 'run*.csv'}\ntime: time\n", files)
    assert [diagnostic.message for diagnostic in caught.value.diagnostics] == [
        "run0.csv has no column `F` for `F` … and 8 more files",
        "run3.csv has no columns `x`, `F`",
    ]
