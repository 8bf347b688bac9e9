"""Rule R10: resampling keeps every measured value that predictions are compared with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
from asammdf import MDF, Signal
from numpy.typing import NDArray
from scipy.io import savemat

import msnn
from msnn.data.dataset import Dataset
from msnn.data.reading.load import load_data
from msnn.data.reading.row_filter import row_filters
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import SpecError

SPEC = """
msnn: 1
name: plant
sample_time: 10 ms
inputs: {u: {}}
targets: {y: {}}
parameters: {k: {init: 1}}
outputs: {o: {expr: k*u, predicts: "y[t]"}}
data: {source: {train: FILE}, time: t, resample: METHOD MORE}
train: [{epochs: 10, optimizer: levenberg_marquardt}]
validate: [{of: o, metric: rmse, data: train}]
"""
Columns = dict[str, NDArray[Any]]


def csv_text(columns: Columns) -> str:
    def cell(value: float) -> str:
        return "" if np.isnan(value) else repr(float(value))

    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines = [",".join(map(cell, row)) for row in rows]
    return "\n".join([",".join(columns), *lines]) + "\n"


def write_csv(path: Path, columns: Columns) -> None:
    path.write_text(csv_text(columns))


def write_mdf(path: Path, columns: Columns) -> None:
    time = columns["t"]
    with MDF(version="4.10") as file:
        for name, values in columns.items():
            there = ~np.isnan(values)
            # each signal in a group of its own, as loggers write signals of several rates
            if name != "t":
                file.append([Signal(values[there], time[there], name=name)])
        file.save(path, overwrite=True)


WRITERS: dict[str, Callable[[Path, Columns], None]] = {
    "a.csv": write_csv,
    "a.npz": lambda path, columns: np.savez(path, **columns),  # pyright: ignore[reportArgumentType]
    "a.mat": savemat,
    "a.parquet": lambda path, columns: parquet.write_table(arrow.table(dict(columns)), path),
    "a.mf4": write_mdf,
}


def load(folder: Path, name: str, method: str, more: str = "", spec: str = SPEC) -> Dataset:
    text = spec.replace("FILE", name).replace("METHOD", method).replace("MORE", more)
    # an MDF file keeps its times itself
    text = text.replace("time: t, ", "") if name.endswith(".mf4") else text
    (folder / "plant.yaml").write_text(text)
    model = load_model(folder / "plant.yaml")
    assert model.spec.data is not None
    return load_data(model.program, model.spec.data, folder, row_filters(model.spec))


def jittered(rows: int, jitter: float) -> Columns:
    """`u` in every row, `y` = 2 u in every fifth; times are off by up to `jitter` seconds."""
    generator = np.random.default_rng(5)
    time = 0.01 * np.arange(rows) + generator.uniform(-jitter, jitter, rows)
    u = np.sin(3 * time)
    return {"t": time, "u": u, "y": np.where(np.arange(rows) % 5 == 0, 2 * u, np.nan)}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("method", ["linear", "nearest"])
@pytest.mark.parametrize("jitter", [0.0, 1e-6, 1e-3])
def test_jitter_loses_no_value_of_a_sparse_target(
    tmp_path: Path, name: str, method: str, jitter: float
) -> None:
    columns = jittered(500, jitter)
    WRITERS[name](tmp_path / name, columns)
    data = load(tmp_path, name, method)
    u, y = data.series["u"], data.series["y"]
    scored = ~np.isnan(y)
    assert np.flatnonzero(scored).tolist() == list(range(0, 500, 5))
    # the values themselves: between two of them, five rows apart, lies no line
    np.testing.assert_array_equal(y[scored], columns["y"][::5])
    # y moves by 6 a second, and rows are off by two jitters; u lies within one
    np.testing.assert_allclose(y[scored], 2 * u[scored], atol=18 * jitter + 1e-9)
    (said,) = data.warnings
    assert (said.code, said.severity) == ("W0830", "note")
    assert "keeps 100 of 100 measured values of column `y`" in said.message


@pytest.mark.parametrize("method", ["linear", "nearest"])
def test_a_value_between_two_rows_belongs_to_the_nearer_one_alone(
    tmp_path: Path, method: str
) -> None:
    """Values 20 times a hundred steps apart, anywhere within a step: no line joins them."""
    time = 0.01 * np.arange(2001)
    at = np.sort(np.random.default_rng(0).uniform(0, 20, 20))
    moments = np.sort(np.concatenate((time, at)))
    columns = {
        "t": moments,
        "u": np.where(np.isin(moments, time), 1.0, np.nan),
        "y": np.where(np.isin(moments, at), 100 * moments, np.nan),
    }
    write_csv(tmp_path / "a.csv", columns)
    data = load(tmp_path, "a.csv", method)
    rows = np.flatnonzero(~np.isnan(data.series["y"]))
    np.testing.assert_array_equal(rows, np.unique(np.rint(at / 0.01)))
    assert data.episodes("train").tolist() == [[0, 2001]]


def every_other_step(steps: int) -> Columns:
    """`u` = 1 in every step; `z` = 0, 100, 0, … in every second one, 40 % of a step behind it."""
    time, at = 0.01 * np.arange(steps), 0.004 + 0.02 * np.arange(steps // 2)
    moments = np.sort(np.concatenate((time, at)))
    is_row = np.isin(moments, time)
    values = np.full(len(moments), np.nan)
    values[~is_row] = 100.0 * (np.arange(steps // 2) % 2)
    return {"t": moments, "u": np.where(is_row, 1.0, np.nan), "y": values}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("method", ["linear", "nearest"])
def test_a_sparse_target_is_scored_with_its_measured_values(
    tmp_path: Path, name: str, method: str
) -> None:
    """0, 100, 0, … against 0: √(100²/2) is 70.71; lines between them would give 58.3."""
    WRITERS[name](tmp_path / name, every_other_step(200))
    data = load(tmp_path, name, method)
    known = ~np.isnan(data.series["y"])
    assert known.sum() == 100
    assert set(data.series["y"][known].tolist()) == {0.0, 100.0}
    assert data.warnings[0].notes == ("values are up to 4 ms away from their rows",)
    model = msnn.load(tmp_path / "plant.yaml")
    (row,) = msnn.validate(model, weights={"k": 0.0}).rows
    assert row.value == pytest.approx(50 * 2**0.5)
    (simulated,) = msnn.simulate(model, weights={"k": 0.0})
    shown = simulated.logged["o"]
    assert sorted(shown[~np.isnan(shown)].tolist()) == [0.0] * 50 + [100.0] * 50
    # trained it is their mean
    assert float(msnn.train(model).weights["k"]) == pytest.approx(50.0)


READ = SPEC.replace("inputs: {u: {}}\ntargets: {y: {}}", "inputs: {u: {}, y: {}}").replace(
    '{expr: k*u, predicts: "y[t]"}', '{expr: "k*y[t]", predicts: "y[t+1]"}'
)


@pytest.mark.parametrize("engine", ["native", "torch"])
@pytest.mark.parametrize("rollout", ["", ", rollout: 3", ", rollout: episode", ", rollout: record"])
def test_rows_of_a_sparse_input_that_were_not_measured_are_not_scored(
    tmp_path: Path, rollout: str, engine: str
) -> None:
    """y = t² every 7 rows: chords between them are no measurements."""
    time = 0.01 * np.arange(99)
    y = np.where(np.arange(99) % 7 == 0, 1 + time**2, np.nan)
    write_csv(tmp_path / "a.csv", {"t": time, "u": time, "y": y})
    spec = READ.replace("epochs: 10", f"epochs: 10, engine: {engine}{rollout}")
    spec = spec.replace("levenberg_marquardt", "adam")
    spec = spec.replace("data: train}", f"data: train{rollout}}}")
    data = load(tmp_path, "a.csv", "linear", spec=spec)
    assert np.flatnonzero(data.measured["y"]).tolist() == list(range(0, 99, 7))
    (said,) = data.warnings
    assert said.code == "W0830"
    assert "keeps 15 of 15 measured values of column `y`" in said.message
    model = msnn.load(tmp_path / "plant.yaml")
    run = msnn.train(model)
    (row,) = msnn.validate(model, weights=run.weights).rows
    assert row.scored == 14
    (simulated,) = msnn.simulate(model, weights=run.weights)
    assert np.isfinite(simulated.logged["o"]).sum() == 14
    # the same rows decide in training, where short rollouts overlap
    if rollout != ", rollout: 3":
        # a kernel trains in float32
        assert run.stages[0].best_value == pytest.approx(row.value**2, rel=1e-5)


def test_every_row_of_a_dense_target_is_scored(tmp_path: Path) -> None:
    time = 0.003 * np.arange(1001)
    write_csv(tmp_path / "a.csv", {"t": time, "u": time, "y": 2 * time})
    data = load(tmp_path, "a.csv", "linear")
    np.testing.assert_allclose(data.series["y"], 2 * data.series["u"], atol=1e-12)
    (said,) = data.warnings
    assert "keeps 301 of 1001" in said.message
    assert said.notes == ("700 are nearest to a row that has one already",)


def test_values_without_a_row_are_told_as_lost(tmp_path: Path) -> None:
    columns = jittered(500, 1e-6)
    columns["u"][102:120] = np.nan
    write_csv(tmp_path / "a.csv", columns)
    data = load(tmp_path, "a.csv", "linear", ", nan: split")
    (said,) = data.warnings
    assert (said.code, said.severity) == ("W0830", "warning")
    assert "keeps 97 of 100" in said.message
    assert said.notes == ("3 are nearest to a row without inputs, or to none",)


def test_values_that_are_not_picked_are_not_lost(tmp_path: Path) -> None:
    write_mdf(tmp_path / "a.mf4", jittered(500, 0.0))
    write_csv(tmp_path / "a.csv", jittered(500, 0.0))
    for name in ("a.mf4", "a.csv"):
        data = load(tmp_path, name, "linear", ", from: 1 s, to: 2 s")
        (said,) = data.warnings
        assert (said.severity, "keeps 21 of 21" in said.message) == ("note", True)


def test_counts_are_of_all_files_before_they_are_joined(tmp_path: Path) -> None:
    columns = jittered(100, 0.0)
    write_csv(tmp_path / "a.csv", columns)
    write_csv(tmp_path / "b.csv", {**columns, "t": columns["t"] + 1.0})
    data = load(tmp_path, "[a.csv, b.csv]", "linear", ", join: true")
    assert len(data.records) == 1
    assert "keeps 40 of 40" in data.warnings[0].message


@pytest.mark.parametrize("section", ["inputs: {x: {}}", "inputs: {}\ntargets: {x: {}}"])
def test_samples_at_uneven_times_are_each_scored_once(tmp_path: Path, section: str) -> None:
    """dx/dt = −k x, x(0) = 2: scipy's least squares of 2 exp(−k t) gives k = 2.51262."""
    (tmp_path / "gk.csv").write_text("t,x\n0,2\n0.1,1.6\n0.2,1.2\n0.4,0.7\n0.8,0.3\n1,0.15\n")
    spec = (
        f"msnn: 1\nname: gk\nsample_time: 0.1 s\n{section}\n"
        "parameters: {k: {init: 1}, x0: {init: 2, learn: false}}\n"
        'states: {s: {der: -k*s, init: x0}}\noutputs: {xh: {expr: s, predicts: "x[t]"}}\n'
        "data: {source: {train: gk.csv}, time: tMORE}\n"
        "train: [{epochs: 50, optimizer: levenberg_marquardt, rollout: record}]\n"
    )
    (tmp_path / "gk.yaml").write_text(spec.replace("MORE", ""))
    with pytest.raises(SpecError) as caught:
        msnn.train(msnn.load(tmp_path / "gk.yaml"))
    (fault,) = caught.value.diagnostics
    assert (fault.code, "usually 0.2 s" in fault.message) == ("E0812", True)
    # the advice as it is written
    assert fault.help is not None
    assert fault.help.startswith("`resample: linear` brings")
    (tmp_path / "gk.yaml").write_text(spec.replace("MORE", ", resample: linear"))
    run = msnn.train(msnn.load(tmp_path / "gk.yaml"))
    # rk4 at a step of 0.1 s
    assert float(run.weights["k"]) == pytest.approx(2.5127, abs=2e-4)


UNION = """
msnn: 1
name: union
sample_time: 10 ms
inputs: {u: {}, y: {}}
outputs: {o: u, p: y}
data: {source: {train: FILE}, time: t, resample: METHOD MORE}
"""


def union_columns() -> Columns:
    """Signals every 10 ms and every 25 ms, a row for each moment at which either was measured."""
    fast, slow = 0.01 * np.arange(101), 0.003 + 0.025 * np.arange(40)
    time = np.union1d(fast, slow)
    return {
        "t": time,
        "u": np.where(np.isin(time, fast), 100 * time, np.nan),
        "y": np.where(np.isin(time, slow), 4000 * (time - 0.003), np.nan),
    }


@pytest.mark.parametrize("name", WRITERS)
def test_inputs_of_several_rates_lie_on_lines_between_their_own_values(
    tmp_path: Path, name: str
) -> None:
    WRITERS[name](tmp_path / name, union_columns())
    data = load(tmp_path, name, "linear", spec=UNION)
    time = 0.003 + 0.01 * np.arange(98)
    np.testing.assert_allclose(data.series["u"], 100 * time, atol=1e-9)
    np.testing.assert_allclose(data.series["y"], 4000 * (time - 0.003), atol=1e-9)
    assert data.episodes("train").tolist() == [[0, 98]]


def test_an_input_that_lost_a_value_is_an_error_or_ends_the_episode(tmp_path: Path) -> None:
    columns = union_columns()
    lost = np.flatnonzero(~np.isnan(columns["y"]))[10]
    columns["y"][lost] = np.nan
    write_csv(tmp_path / "a.csv", columns)
    with pytest.raises(SpecError, match="E0809") as caught:
        load(tmp_path, "a.csv", "linear", spec=UNION)
    (fault,) = caught.value.diagnostics
    assert "column `y` has no value" in fault.message
    assert fault.span is not None
    assert lost - 6 < fault.span.line - 2 <= lost
    data = load(tmp_path, "a.csv", "linear", ", nan: split", spec=UNION)
    # the value before is at 228 ms, the one behind at 278 ms: 233 … 273 ms are not known
    assert data.episodes("train").tolist() == [[0, 23], [28, 98]]


def test_a_filter_reads_between_the_values_of_a_slow_target(tmp_path: Path) -> None:
    columns = jittered(500, 0.0)
    columns["y"] = np.where(np.isnan(columns["y"]), np.nan, columns["t"])
    write_csv(tmp_path / "a.csv", columns)
    data = load(tmp_path, "a.csv", "linear", ', filter: "y < 2.02"')
    assert data.episodes("train").tolist() == [[0, 202]]
    assert np.isfinite(data.series["y"]).sum() == 100


@pytest.mark.parametrize("begin", [0.0, 1.7e9])
def test_a_hole_is_one_at_any_time_of_day(tmp_path: Path, begin: float) -> None:
    time = begin + np.concatenate((np.arange(10.0), 12.0 + np.arange(10.0))) * 0.01
    write_csv(tmp_path / "a.csv", {"t": time, "u": time, "y": time})
    data = load(tmp_path, "a.csv", "nearest")
    assert data.episodes("train").tolist() == [[0, 10], [12, 22]]


READERS = {
    "its derivative": ("", 'losses: {d: "mse(o, der(y, method=central))"}'),
    "a start": ('states: {s: {next: "0.9 * s", init: "y[t]"}}', ""),
    "a start of two rows": ('states: {s: {next: "0.9 * s", init: "y[t] - y[t-1]"}}', ""),
}


@pytest.mark.parametrize("reader", READERS)
def test_what_reads_several_rows_of_a_target_finds_lines_between_its_values(
    tmp_path: Path, reader: str
) -> None:
    """A target of 50 ms at a sample time of 10 ms; a hole of half a second stays one."""
    states, losses = READERS[reader]
    columns = jittered(500, 0.0)
    columns["y"][200:250] = np.nan
    write_csv(tmp_path / "a.csv", columns)
    output = "outputs: {o: {expr: k*u" + (" + s" if states else "")
    spec = SPEC.replace("outputs: {o: {expr: k*u", f"{states}\n{output}")
    spec = spec.replace("data:", f"{losses}\ndata:", 1)
    data = load(tmp_path, "a.csv", "linear", spec=spec)
    # an input that is there in all rows: nothing ends an episode
    assert data.episodes("train").tolist() == [[0, 500]]
    known = np.isfinite(data.series["y"])
    if reader == "a start":
        assert known.sum() == 90
    else:
        assert np.flatnonzero(~known).tolist() == [*range(196, 250), *range(496, 500)]


@pytest.mark.parametrize("name", ["a.csv", "a.mf4"])
@pytest.mark.parametrize("method", ["linear", "nearest"])
@pytest.mark.parametrize("late", [-0.002, 0.003, 0.005, 0.063])
def test_validate_and_simulate_use_one_grid(
    tmp_path: Path, name: str, method: str, late: float
) -> None:
    """An input that a model predicts, every 100 ms, begins and ends off the rows of the other."""
    time, at = 100 + 0.01 * np.arange(400), 100 + late + 0.1 * np.arange(40)
    moments = np.union1d(np.round(time, 3), np.round(at, 3))
    u = np.where(np.isin(moments, np.round(time, 3)), np.cos(3 * moments), np.nan)
    y = np.where(np.isin(moments, np.round(at, 3)), np.sin(9 * moments), np.nan)
    WRITERS[name](tmp_path / name, {"t": moments, "u": u, "y": y})
    spec = READ.replace('"k*y[t]"', '"0.9*y + 0.1*u"').replace("parameters: {k: {init: 1}}\n", "")
    spec = spec.replace("data: train}", "data: train, rollout: record}")
    data = load(tmp_path, name, method, spec=spec)
    first = 0 if late < 0.006 else 6
    time_of_rows = data.records[0].pieces[0].time
    assert time_of_rows is not None
    np.testing.assert_allclose(time_of_rows[0], 100 + 0.01 * first, atol=1e-9)
    model = msnn.load(tmp_path / "plant.yaml")
    (row,) = msnn.validate(model).rows
    (run,) = msnn.simulate(model)
    places = run.places.time
    assert places is not None
    np.testing.assert_allclose(places[0], 100 + 0.01 * first, atol=1e-9)
    errors = run.outputs["o"] - run.logged["o"]
    assert row.value == pytest.approx(np.sqrt(np.nanmean(errors**2)), rel=1e-6)
    assert row.scored == np.isfinite(errors).sum()
