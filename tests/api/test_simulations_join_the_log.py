"""What `simulate` writes stands beside the rows of the log it belongs to, whatever picks them."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from asammdf import MDF, Signal

import msnn
from msnn.cli.application import run
from msnn.simulation.simulate import Simulations, run_record, simulation_program, write_simulation

SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {x: {unit: m}, u: N}
targets: {z: N}
parameters: {a: 0.5, b: {init: 0.1, unit: m/N}}
outputs:
  x_next: {expr: a*x + b*u, predicts: "x[t+1]"}
  y: {expr: 2*u, predicts: "z[t]"}
"""

STATIC = """
msnn: 1
name: plant
inputs: {u: N}
targets: {z: N}
outputs:
  y: {expr: 2*u, predicts: "z[t]"}
"""


def log(rows: int, start: float = 100.0, step: float = 0.1, seed: int = 0) -> Any:
    """A data frame whose time begins at `start`; its cells are unlike each other."""
    draw = np.random.default_rng([seed, rows])
    time = np.round(start + step * np.arange(rows), 6)
    return pd.DataFrame(
        {"t": time, "x": draw.normal(size=rows), "u": draw.normal(size=rows), "z": time * 7}
    )


def write(folder: Path, name: str, frame: Any) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".npz":
        np.savez(path, **{str(c): frame[c].to_numpy() for c in frame.columns})
    elif path.suffix == ".parquet":
        frame.to_parquet(path)
    else:
        frame.to_csv(path, index=False)


def model(folder: Path, data: str, spec: str = SPEC) -> msnn.Model:
    path = folder / "plant.yaml"
    path.write_text(f"{spec}data:\n  {data}\n" if data else spec)
    return msnn.load(path)


def table(folder: Path, model: msnn.Model, runs: Simulations) -> Any:
    """What is written, as somebody reads it who joins it with the log."""
    path = write_simulation(folder / "out.csv", simulation_program(model.program), runs)
    return pd.read_csv(path, keep_default_na=True)


def check_rows(found: Any, read: Callable[[str], Any], ahead: int = 1) -> None:
    """Every row of the table belongs to the row of its file; `ahead` rows on is the next sample."""
    assert len(found)
    for name, part in found.groupby("file"):
        file = read(str(name))
        rows = part["row"].to_numpy()
        np.testing.assert_array_equal(part["time"], file["t"].to_numpy()[rows])
        np.testing.assert_array_equal(part["y"], 2 * file["u"].to_numpy()[rows])
        np.testing.assert_array_equal(part["y.log"], file["z"].to_numpy()[rows])
        if "x_next.log" not in part:
            continue
        measured = part["x_next.log"].notna().to_numpy()
        np.testing.assert_array_equal(
            part["x_next.log"][measured], file["x"].to_numpy()[rows[measured] + ahead]
        )


SOURCES = {
    "files of different lengths": "{source: {train: '*.csv'}, time: t}",
    "sets of one file": "{source: {train: {files: a.csv, to: 9}, val: {files: a.csv, from: 10}}, "
    "time: t}",
    "rows by number": "{source: {train: '*.csv'}, time: t, from: 3, to: 20}",
    "rows by time": "{source: {train: '*.csv'}, time: t, from: 100.5 s}",
    "a split by fraction": "{source: {train: '*.csv'}, time: t, split: {by: fraction, val: 0.5}}",
    "a split by block": "{source: {train: '*.csv'}, time: t, "
    "split: {by: block, blocks: 4, val: [2]}}",
    "a filter": "{source: {train: '*.csv'}, time: t, filter: 'u > -0.8'}",
    "missing inputs": "{source: {train: '*.csv'}, time: t, nan: split}",
}


@pytest.mark.parametrize("data", SOURCES.values(), ids=SOURCES.keys())
def test_rows_times_and_measured_values_are_those_of_the_file(tmp_path: Path, data: str) -> None:
    for number, rows in enumerate((40, 25, 31)):
        write(tmp_path, f"{'abc'[number]}.csv", log(rows, 100.0 + number))
    if "nan" in data:
        holed = log(40)
        holed.loc[[7, 20], "u"] = np.nan
        write(tmp_path, "a.csv", holed)
    plant = model(tmp_path, data)
    runs = msnn.simulate(plant)
    check_rows(table(tmp_path, plant, runs), lambda name: pd.read_csv(tmp_path / name))


def test_sets_are_those_of_the_rows_and_can_be_chosen(tmp_path: Path) -> None:
    write(tmp_path, "a.csv", log(40))
    plant = model(tmp_path, "{source: {train: a.csv}, time: t, split: {by: fraction, val: 0.25}}")
    whole = table(tmp_path, plant, msnn.simulate(plant))
    assert whole["set"].tolist() == ["train"] * 30 + ["val"] * 10
    val = table(tmp_path, plant, msnn.simulate(plant, data_set="val"))
    assert (val["set"].unique().tolist(), val["row"].tolist()) == (["val"], list(range(30, 40)))
    with pytest.raises(msnn.SpecError, match=r"E0953.*`vall`"):
        msnn.simulate(plant, data_set="vall")
    with pytest.raises(msnn.SpecError, match="E0820"):
        msnn.simulate(plant, data_set="test")


def test_elements_are_labelled_in_the_order_of_their_axes(tmp_path: Path) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text("""
msnn: 1
name: plant
sample_time: 0.1 s
dims: {axle: [front, rear], side: [left, mid, right]}
inputs: {u: {}}
constants:
  a: {value: [1, 10], dims: axle}
  b: {value: [1, 2, 3], dims: side}
outputs: {y: u * a * b}
data: {source: {train: '*.csv'}, time: t}
""")
    for name in ("a.csv", "b.csv"):
        write(tmp_path, name, log(5))
    runs = msnn.simulate(plant := msnn.load(path))
    # each counts the rows of its own record
    assert [run.first for run in runs] == [0, 0]
    found = table(tmp_path, plant, runs)
    u = np.tile(log(5)["u"], 2)
    for axle, a in (("front", 1), ("rear", 10)):
        for side, b in (("left", 1), ("mid", 2), ("right", 3)):
            np.testing.assert_allclose(found[f"y[{axle},{side}]"], u * a * b, rtol=1e-15)


def test_runs_of_files_without_time_have_rows_beside_those_that_have_both(tmp_path: Path) -> None:
    """Without a sample time nobody knows the moments of rows of a file that does not say them."""
    for name in ("a.csv", "b.csv"):
        write(tmp_path, name, log(20))
    data = "{source: {train: {files: a.csv, time: t}, val: b.csv}}"
    plant = model(tmp_path, data, STATIC)
    runs = msnn.simulate(plant)
    found = table(tmp_path, plant, runs)
    assert found.columns.tolist() == ["file", "set", "row", "time", "y", "y.log"]
    timed, untimed = (found[found["file"] == name] for name in ("a.csv", "b.csv"))
    check_rows(timed, lambda name: pd.read_csv(tmp_path / name))
    assert untimed["time"].isna().all()
    assert untimed["row"].tolist() == list(range(20))
    np.testing.assert_array_equal(untimed["y"], timed["y"])
    records = [run_record(run) for run in runs]
    assert [record["time"] for record in records] == [[100.0, 101.9], None]
    assert [record["rows"] for record in records] == [[0, 19]] * 2
    for only in ("a.csv", "b.csv"):
        one = [run for run in runs if run.record.file == only]
        header = table(tmp_path, plant, Simulations(tuple(one))).columns.tolist()
        assert ("time" in header) == (only == "a.csv")


def test_rows_of_no_set_name_none(tmp_path: Path) -> None:
    write(tmp_path, "a.csv", log(40))
    sets = "split: {by: time, train: [100 s, 101 s], val: [102 s, 103 s]}"
    plant = model(tmp_path, f"{{source: {{train: a.csv}}, time: t, {sets}}}")
    found = table(tmp_path, plant, msnn.simulate(plant))
    named = np.full(40, "", dtype=object)
    named[:10], named[20:30] = "train", "val"
    assert found["set"].fillna("").tolist() == named.tolist()


def test_a_long_run_is_written_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, "a.csv", log(40))
    plant = model(tmp_path, "{source: {train: a.csv}, time: t}")
    runs = msnn.simulate(plant)
    widths = {"y": np.arange(40.0)}
    runs = Simulations(tuple(replace(run, bands=widths) for run in runs))
    monkeypatch.setattr("msnn.simulation.simulate._ROWS", 7)
    found = table(tmp_path, plant, runs)
    check_rows(found, lambda name: pd.read_csv(tmp_path / name))
    assert found["row"].tolist() == list(range(40))
    np.testing.assert_array_equal(found["y.low"], found["y"] - widths["y"])
    np.testing.assert_array_equal(found["y.high"], found["y"] + widths["y"])


def test_rows_that_every_leaves_keep_their_numbers(tmp_path: Path) -> None:
    write(tmp_path, "a.csv", log(41, step=0.05))
    plant = model(tmp_path, "{source: {train: a.csv}, time: t, every: 2, from: 1}")
    found = table(tmp_path, plant, msnn.simulate(plant))
    assert found["row"].tolist() == list(range(1, 41, 2))
    check_rows(found, lambda name: pd.read_csv(tmp_path / name), ahead=2)


def test_a_log_without_time_counts_from_its_first_row(tmp_path: Path) -> None:
    write(tmp_path, "a.csv", log(40).drop(columns="t"))
    write(tmp_path, "b.csv", log(20).drop(columns="t"))
    plant = model(tmp_path, "{source: {train: '*.csv'}, from: 5}")
    found = table(tmp_path, plant, msnn.simulate(plant))
    assert found["row"].tolist() == [*range(5, 40), *range(5, 20)]
    np.testing.assert_allclose(found["time"], 0.1 * found["row"], rtol=1e-15)


def test_what_joins_as_one_record_has_the_rows_of_each_file(tmp_path: Path) -> None:
    whole = log(40)
    write(tmp_path, "a.csv", whole[:25])
    write(tmp_path, "b.csv", whole[25:])
    plant = model(tmp_path, "{source: {train: '*.csv'}, time: t, join: true}")
    runs = msnn.simulate(plant)
    assert len(runs) == 1
    found = table(tmp_path, plant, runs)
    assert found["row"].tolist() == [*range(25), *range(15)]
    assert found["file"].tolist() == ["a.csv"] * 25 + ["b.csv"] * 15
    np.testing.assert_array_equal(found["y"], 2 * whole["u"])
    np.testing.assert_array_equal(found["x_next.log"][:-1], whole["x"][1:])


def test_resampled_moments_have_a_row_only_where_the_file_has_one(tmp_path: Path) -> None:
    file = log(60, step=0.04)
    file = file.drop(index=range(30, 41)).reset_index(drop=True)  # a hole
    write(tmp_path, "a.csv", file)
    plant = model(tmp_path, "{source: {train: a.csv}, time: t, resample: linear}")
    runs = msnn.simulate(plant)
    found = table(tmp_path, plant, runs)
    assert len(runs) == 2
    there = found["row"].notna()
    assert 0 < there.sum() < len(found)
    rows = found["row"][there].astype(int)
    np.testing.assert_allclose(found["time"][there], file["t"][rows], rtol=0, atol=1e-9)
    # the grid misses printed times by a hair, over which 2 u moves by less than 1e-10
    np.testing.assert_allclose(found["y"][there], 2 * file["u"][rows], rtol=0, atol=1e-9)
    between = np.interp(found["time"], file["t"], file["z"])
    np.testing.assert_allclose(found["y.log"], between, rtol=1e-12)
    # no measured value is drawn through the hole behind the last step before it
    ends = np.flatnonzero(np.diff(found["time"]) > 0.15)
    assert len(ends) == 1
    assert found["x_next.log"][ends].isna().all()


def test_nothing_measured_is_shown_beyond_a_gap(tmp_path: Path) -> None:
    file = log(40).drop(index=20)
    write(tmp_path, "a.csv", file)
    plant = model(tmp_path, "{source: {train: a.csv}, time: t, resample: none}")
    found = table(tmp_path, plant, msnn.simulate(plant))
    assert found["row"].tolist() == list(range(39))
    assert found["row"][found["x_next.log"].isna()].tolist() == [19, 38]


@pytest.mark.parametrize("suffix", [".npz", ".parquet", ".tsv"])
def test_other_formats_join_alike(tmp_path: Path, suffix: str) -> None:
    frame = log(30)
    if suffix == ".tsv":
        frame.to_csv(tmp_path / "a.tsv", index=False, sep="\t")
    else:
        write(tmp_path, f"a{suffix}", frame)
    plant = model(tmp_path, f"{{source: {{train: a{suffix}}}, time: t, from: 4}}")
    check_rows(table(tmp_path, plant, msnn.simulate(plant)), lambda _: frame)


def test_lines_that_are_no_data_are_not_counted(tmp_path: Path) -> None:
    frame = log(30)
    lines = frame.to_csv(index=False).splitlines()
    lines[7:7] = ["# the operator was here", ""]
    (tmp_path / "a.csv").write_text("\n".join(["logger 3", *lines]) + "\n")
    plant = model(tmp_path, "{source: {train: a.csv}, time: t, csv: {comment: '#', skip: 1}}")
    check_rows(table(tmp_path, plant, msnn.simulate(plant)), lambda _: frame)


@pytest.mark.parametrize("bare", ["a.csv", "b.csv"])
def test_what_a_file_does_not_measure_is_empty(tmp_path: Path, bare: str) -> None:
    for name in ("a.csv", "b.csv"):
        write(tmp_path, name, log(20).drop(columns=["z"] if name == bare else []))
    plant = model(tmp_path, "{source: {train: '*.csv'}, time: t}")
    found = table(tmp_path, plant, msnn.simulate(plant))
    np.testing.assert_array_equal(found["y.log"].notna(), found["file"] != bare)


def test_given_files_are_laid_out_like_a_set_that_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "a.csv", log(20))
    write(tmp_path, "b.csv", log(30).rename(columns={"u": "force"}))
    plant = model(
        tmp_path,
        "{source: {train: {files: a.csv, from: 5}, val: {files: b.csv, columns: {u: force}}}, "
        "time: t}",
    )
    check_rows(
        table(tmp_path, plant, msnn.simulate(plant, "b.csv", data_set="val")),
        lambda _: pd.read_csv("b.csv").rename(columns={"force": "u"}),
    )
    with pytest.raises(msnn.SpecError, match=r"E0958.*`train`, `val`") as caught:
        msnn.simulate(plant, "b.csv")
    assert "--data-set" in (caught.value.diagnostics[0].help or "")
    with pytest.raises(msnn.SpecError, match="E0953"):
        msnn.simulate(plant, "b.csv", data_set="test")


@pytest.mark.parametrize("data_set", [None, "train"])
def test_given_files_are_filtered_as_the_spec_says(
    data_set: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "a.csv", log(20))
    write(tmp_path, "b.csv", log(30))
    plant = model(tmp_path, "{source: {train: a.csv}, filter: u > 0, time: t}")
    runs = msnn.simulate(plant, "b.csv", data_set=data_set)
    assert min(float(run.inputs["u"].min()) for run in runs) > 0


def test_frames_join_as_files_do(tmp_path: Path) -> None:
    plant = model(tmp_path, "{source: {train: none.csv}, time: t, split: {by: file, val: 0.5}}")
    frames = {"calm": [log(30), log(20, 300)], "storm": log(25, 500)}
    found = table(tmp_path, plant, msnn.simulate(plant, frames))
    assert list(found["set"].unique()) == ["calm", "storm"]
    by_name = {"calm[0]": frames["calm"][0], "calm[1]": frames["calm"][1], "storm[0]": log(25, 500)}
    check_rows(found, lambda name: by_name[name])
    storm = table(tmp_path, plant, msnn.simulate(plant, frames, data_set="storm"))
    assert len(storm) == 25


def test_the_command_writes_and_prints_the_same_places(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "a.csv", log(40))
    model(tmp_path, "{source: {train: a.csv}, time: t, split: {by: fraction, val: 0.25}}")
    words = ["simulate", "plant.yaml", "--initial", "--data-set", "val", "--format", "json"]
    assert run(words) == 0
    printed: dict[str, Any] = json.loads(capsys.readouterr().out)
    file = log(40)
    assert printed["runs"] == [
        {
            "files": ["a.csv"],
            "sets": ["val"],
            "steps": 10,
            "rows": [30, 39],
            "time": [file["t"][30], file["t"][39]],
        }
    ]
    with (tmp_path / "simulation.csv").open(newline="") as written:
        header = next(csv.reader(written))
    assert header == ["file", "set", "row", "time", "x_next", "y", "x_next.log", "y.log"]


def test_records_that_are_too_short_are_named(tmp_path: Path) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text(SPEC.replace("2*u", '"mean(u[t-9:t])"') + "data: {source: {train: '*.csv'}}\n")
    write(tmp_path, "a.csv", log(30))
    write(tmp_path, "b.csv", log(4))
    runs = msnn.simulate(msnn.load(path))
    assert [(warning.code, "b.csv" in warning.message) for warning in runs.warnings] == [
        ("W0802", True)
    ]


def test_plots_draw_over_the_time_of_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from msnn.reports import plotting
    from msnn.reports.simulation_plots import plot_simulation

    write(tmp_path, "a.csv", log(40))
    plant = model(tmp_path, "{source: {train: a.csv}, time: t, split: {by: fraction, val: 0.25}}")
    drawn: list[Any] = []

    def keep(figure: Any, path: Path) -> Path:
        drawn.append(figure)
        return path

    monkeypatch.setattr(plotting, "saved_figure", keep)
    runs = msnn.simulate(plant)
    plot_simulation(tmp_path / "a.png", simulation_program(plant.program), runs)
    axis = drawn[0].axes[0]
    np.testing.assert_array_equal(axis.lines[0].get_xdata(), log(40)["t"])
    assert axis.get_title(loc="left") == "a.csv, train, val"


def test_recordings_with_times_of_their_own_join_alike(tmp_path: Path) -> None:
    frame = log(40, start=3.0)
    with MDF() as file:
        file.append(
            [Signal(frame[n].to_numpy(), frame["t"].to_numpy(), name=n) for n in ("x", "u")]
        )
        # what is measured at other times is put beside the steps, and has no say in them
        file.append([Signal(frame["z"].to_numpy()[5:], frame["t"].to_numpy()[5:], name="z")])
        file.save(tmp_path / "a.mf4")
    plant = model(tmp_path, "{source: {train: a.mf4}}")
    found = table(tmp_path, plant, msnn.simulate(plant))
    assert found["row"].tolist() == list(range(40))
    np.testing.assert_array_equal(found["time"], frame["t"])
    np.testing.assert_array_equal(found["y"], 2 * frame["u"])
    assert "y.log" not in found or found["y.log"].isna().all()
    plant = model(tmp_path, "{source: {train: a.mf4}, resample: linear}")
    found = table(tmp_path, plant, msnn.simulate(plant))
    assert found["row"].isna().all()
    np.testing.assert_allclose(found["time"], frame["t"], rtol=0, atol=1e-9)
    assert found["y.log"].isna().tolist() == [True] * 5 + [False] * 35
    np.testing.assert_allclose(found["y.log"][5:], frame["z"][5:], rtol=1e-9)


@pytest.mark.parametrize("more", ["", ", resample: linear", ", from: 5, to: 44"])
def test_time_goes_on_in_files_that_are_joined_by_their_dates(tmp_path: Path, more: str) -> None:
    """As it does where times are numbers: a run has one clock."""
    begin = pd.Timestamp("2026-11-22 23:59:58")
    for name, frame in (("b.csv", log(30, 0.0)), ("a.csv", log(20, 3.0))):
        frame["t"] = [(begin + pd.Timedelta(seconds=t)).isoformat() for t in frame["t"]]
        write(tmp_path, name, frame)
    data = f"source: {{train: '*.csv'}}, time: t, join: true{more}"
    it = model(tmp_path, data.replace(", ", "\n  "))
    runs = msnn.simulate(it)
    (run,) = runs
    time = run.places.time
    assert time is not None
    first = 0.5 if "from" in more else 0.0
    np.testing.assert_allclose(time, first + 0.1 * np.arange(run.steps), atol=1e-9)
    assert set(run.places.files) == {"a.csv", "b.csv"}
    np.testing.assert_array_equal(np.asarray(table(tmp_path, it, runs)["time"]), time)
