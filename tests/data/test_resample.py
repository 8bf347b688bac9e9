"""Rule R10: `resample:` brings rows to the sample time and invents nothing over holes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF, Signal

from msnn.data.dataset import FloatArray
from msnn.data.formats.table import ColumnKey
from msnn.data.reading.resample import resample
from spec_schema.diagnostics.diagnostic import SpecError
from tests.data.specs import load


def rows(times: list[float]) -> str:
    return "time,x,F\n" + "".join(f"{t!r},{2 * t!r},{-t!r}\n" for t in times)


def test_linear_draws_straight_lines(tmp_path: Path) -> None:
    files = {"a.csv": rows([0, 0.15, 0.31, 0.5, 0.62, 0.8])}
    data = load(tmp_path, "source: {train: a.csv}\ntime: time\nresample: linear\n", files)
    np.testing.assert_allclose(data.series["x"], [0, 0.4, 0.8, 1.2, 1.6], atol=1e-12)
    np.testing.assert_allclose(data.series["F"], [0, -0.2, -0.4, -0.6, -0.8], atol=1e-12)
    assert data.episodes("train").tolist() == [[0, 5]]


def test_nearest_takes_the_closest_row(tmp_path: Path) -> None:
    files = {"a.csv": rows([0, 0.15, 0.31, 0.5, 0.62, 0.8])}
    data = load(tmp_path, "source: {train: a.csv}\ntime: time\nresample: nearest\n", files)
    np.testing.assert_allclose(data.series["x"], [0, 0.3, 0.62, 1.24, 1.6], atol=1e-12)


def test_a_hole_ends_the_episode(tmp_path: Path) -> None:
    files = {"a.csv": rows([0, 0.2, 0.4, 1.6, 1.8, 2.0])}
    data = load(tmp_path, "source: {train: a.csv}\ntime: time\nresample: linear\n", files)
    assert data.episodes("train").tolist() == [[0, 3], [8, 11]]


def test_a_missing_value_is_not_filled(tmp_path: Path) -> None:
    text = "time,x,F\n0,1,1\n0.2,2,1\n0.4,,1\n0.6,4,1\n0.8,5,1\n"
    section = "source: {train: a.csv}\ntime: time\nresample: linear\nnan: split\n"
    data = load(tmp_path, section, {"a.csv": text})
    assert data.episodes("train").tolist() == [[0, 2], [3, 5]]


@pytest.mark.parametrize("begin", [0.0, 1e3, 1.7e9])
@pytest.mark.parametrize("count", [4, 8, 58])
def test_rounding_of_times_loses_no_last_row(begin: float, count: int) -> None:
    """0.3 / 0.1 is 2.9999999999999996: of four rows the last would be cut off."""
    time = begin + np.array([round(0.1 * k, 1) for k in range(count)])
    values = np.arange(float(count))
    for beside in ([], ["slow"]):
        columns: dict[ColumnKey, tuple[FloatArray, FloatArray]] = {
            "x": (time, values),
            "slow": (time, values),
        }
        found = resample(columns, 0.1, "linear", beside=beside)
        assert found.covered.tolist() == [True] * count
        for column in found.columns.values():
            # times of 1.7e9 s have steps of 2.4e-7
            np.testing.assert_allclose(column, values, atol=1e-5)


def test_of_two_rows_alike_far_the_earlier_is_taken() -> None:
    """The later one was not known then; a hole begins behind its first and ends before its last."""
    time = np.array([0.0, 0.5, 1.5, 2.5, 7.0, 7.5])
    found = resample({"x": (time, np.arange(6.0))}, 1.0, "nearest")
    assert found.time.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    assert found.columns["x"].tolist() == [0.0, 1.0, 2.0, 3.0, 3.0, 4.0, 4.0, 4.0]
    assert found.covered.tolist() == [True, True, True, False, False, False, False, True]


def test_a_hole_leaves_the_rows_at_its_ends_and_a_slow_column_has_none() -> None:
    steady, holed, slow = np.arange(11.0), np.array([0.0, 1.0, 2.0, 6.0, 7.0, 10.0]), np.arange(3.0)
    columns: dict[ColumnKey, tuple[FloatArray, FloatArray]] = {
        "steady": (steady, steady),
        "slow": (5.0 * slow, slow),
    }
    assert resample(columns, 1.0, "linear").covered.all()
    found = resample({**columns, "holed": (holed, holed)}, 1.0, "linear")
    assert np.flatnonzero(~found.covered).tolist() == [3, 4, 5, 8, 9]
    assert found.columns["slow"].tolist() == pytest.approx((steady / 5.0).tolist())


@pytest.mark.parametrize("begin", [0.0, 0.05, 3.2, 1.7e9])
def test_rounding_of_times_breaks_no_tie(begin: float) -> None:
    """A row every 200 ms, moments every 100 ms: each second one is in the middle of two rows."""
    time = np.array([round(begin + 0.2 * k, 3) for k in range(40)])
    found = resample({"x": (time, np.arange(40.0))}, 0.1, "nearest")
    assert found.columns["x"].tolist() == [float(k // 2) for k in range(79)]


def test_a_value_half_a_step_before_the_first_moment_is_kept() -> None:
    samples = (np.array([0.95, 1.15, 1.35]), np.arange(3.0))
    columns: dict[ColumnKey, tuple[FloatArray, FloatArray]] = {
        "u": (np.array([1.0, 1.1, 1.2, 1.3]), np.arange(4.0)),
        "y": samples,
    }
    found = resample(columns, 0.1, "nearest", scored={"y"}, compared={"y"})
    assert found.moments["y"].tolist() == [0, 1, 3]


def test_from_and_to_choose_what_is_resampled(tmp_path: Path) -> None:
    files = {"a.csv": rows([0, 0.15, 0.31, 0.5, 0.62, 0.8])}
    section = "source: {train: a.csv}\ntime: time\nresample: linear\nfrom: 0.1 s\nto: 0.7 s\n"
    data = load(tmp_path, section, files)
    np.testing.assert_allclose(data.series["x"], [0.3, 0.7, 1.1], atol=1e-12)


def test_streams_of_different_rates_need_resampling(tmp_path: Path) -> None:
    fast, slow = 0.05 * np.arange(41), 0.1 * np.arange(1, 19)
    with MDF(version="4.10") as file:
        file.append([Signal(2 * fast, fast, name="x")])
        file.append([Signal(-slow, slow, name="F")])
        file.save(tmp_path / "a.mf4", overwrite=True)
    with pytest.raises(SpecError, match="E0842"):
        load(tmp_path, "source: {train: a.mf4}\n")
    data = load(tmp_path, "source: {train: a.mf4}\nresample: linear\n")
    np.testing.assert_allclose(data.series["x"], 0.2 + 0.4 * np.arange(9), atol=1e-12)
    np.testing.assert_allclose(data.series["F"], -0.1 - 0.2 * np.arange(9), atol=1e-12)
    part = load(tmp_path, "source: {train: a.mf4}\nresample: linear\nfrom: 0.5 s\n")
    np.testing.assert_allclose(part.series["F"][0], -0.5, atol=1e-12)
    with pytest.raises(SpecError, match="E0845"):
        load(tmp_path, "source: {train: a.mf4}\nresample: linear\nfrom: 3\n")
    with pytest.raises(SpecError, match="E0845"):
        load(tmp_path, "source: {train: a.mf4}\nresample: linear\nevery: 2\n")


def test_resampling_needs_times_that_increase(tmp_path: Path) -> None:
    section = "source: {train: a.csv}\nresample: linear\n"
    with pytest.raises(SpecError, match="E0843"):
        load(tmp_path, section, {"a.csv": rows([0, 0.2, 0.4])})
    with pytest.raises(SpecError, match="E0813"):
        load(tmp_path, section + "time: time\n", {"a.csv": rows([0, 0.2, 0.2, 0.4])})


def test_streams_without_a_common_moment(tmp_path: Path) -> None:
    with MDF(version="4.10") as file:
        file.append([Signal(np.ones(3), np.array([0.0, 0.2, 0.4]), name="x")])
        file.append([Signal(np.ones(3), np.array([5.0, 5.2, 5.4]), name="F")])
        file.save(tmp_path / "a.mf4", overwrite=True)
    with pytest.raises(SpecError, match=r"the columns of a\.mf4 have no time in common"):
        load(tmp_path, "source: {train: a.mf4}\nresample: nearest\n")


def test_columns_of_a_table_without_a_common_moment(tmp_path: Path) -> None:
    rows = [f"{0.2 * i:.1f},{i if i < 4 else ''},{i if i > 5 else ''}" for i in range(10)]
    text = "time,x,F\n" + "\n".join(rows) + "\n"
    section = "source: {train: a.csv}\ntime: time\nresample: linear\n"
    with pytest.raises(SpecError, match="E0809"):
        load(tmp_path, section, {"a.csv": text})
    with pytest.raises(SpecError, match=r"the columns of a\.csv have no time in common"):
        load(tmp_path, section + "nan: split\n")
    dropped = load(tmp_path, section + "nan: drop\n")
    assert (dropped.rows, [warning.code for warning in dropped.warnings]) == (0, ["W0803"])


def test_one_row_stands_for_itself() -> None:
    one = np.array([3.0])
    found = resample({"x": (np.array([1.0]), one)}, 0.1, "nearest")
    np.testing.assert_array_equal(found.columns["x"], one)


def test_columns_beside_have_no_say_in_the_moments() -> None:
    time = np.arange(10, dtype=np.float64)
    late = np.array([3.0, 4.0, 8.0, 9.0, 10.0])
    found = resample(
        {"u": (time, time), "z": (late, np.multiply(late, 2))}, 1.0, "linear", beside={"z"}
    )
    np.testing.assert_array_equal(found.time, time)
    assert found.covered.all()
    nan = np.nan
    np.testing.assert_array_equal(found.columns["z"], [nan, nan, nan, 6, 8, nan, nan, nan, 16, 18])


JITTER = [0, 0.201, 0.399, 0.602, 1.012, 1.199, 1.4, 1.601]
"""Seconds; the row at 0.8 is lost, which makes a step of 0.41."""


@pytest.mark.parametrize(
    ("gap", "episodes"),
    [
        ("", [[0, 9]]),
        ("gap: 2", [[0, 4], [6, 9]]),
        ("gap: 2.1", [[0, 9]]),
        ("gap: 400 ms", [[0, 4], [6, 9]]),
        ("gap: 1 s", [[0, 9]]),
        # less than 1.5 usual steps are none
        ("gap: 1 ms", [[0, 4], [6, 9]]),
    ],
)
@pytest.mark.parametrize("of_set", [False, True])
def test_one_lost_row_ends_no_episode(
    tmp_path: Path, gap: str, episodes: list[list[int]], of_set: bool
) -> None:
    own = f", {gap}" if of_set and gap else ""
    section = f"source: {{train: {{files: a.csv{own}}}}}\ntime: time\nresample: linear\n"
    section += "" if of_set else gap
    data = load(tmp_path, section, {"a.csv": rows(JITTER)})
    assert data.episodes("train").tolist() == episodes


@pytest.mark.parametrize(("gap", "records"), [("2.5", 1), ("2", 2), ("300 ms", 2), ("2 s", 1)])
def test_files_are_joined_over_steps_that_are_no_hole(
    tmp_path: Path, gap: str, records: int
) -> None:
    files = {"a.csv": rows([0, 0.2, 0.4]), "b.csv": rows([0.85, 1.0, 1.2])}
    section = "source: {train: '*.csv'}\ntime: time\nresample: linear\njoin: true\n"
    assert len(load(tmp_path, section + f"gap: {gap}\n", files).records) == records
