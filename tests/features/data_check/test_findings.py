"""Each finding about the data of a spec: its code, its place, the key that it says to write."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from msnn.data.dataset import FloatArray
from msnn.data.reading.load import load_data
from msnn.features.data_check.check import check_data
from msnn.features.data_check.found import DataCheck
from msnn.features.data_check.report import check_record, check_tables
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.diagnostics.explain import known_codes
from tests.cli.command_line import CommandLine
from tests.features.data_check.systems import clock, first_order, held, multisine, noisy

SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: {unit: V}, y: {unit: K}}
layers: {from_y: {fir: {window: 3}}, from_u: {fir: {window: 3}}}
outputs: {y_next: {expr: from_y(y) + from_u(u), predicts: "y[t+1]"}}
data: {source: {train: data.csv}, time: time}
train: [{rollout: 40}]
"""
ROWS = 3_000


def columns(rows: int = ROWS) -> dict[str, FloatArray]:
    """A clean record: first order, 15 rows, delay 1, around 300 K."""
    u = held(rows)
    return {
        "time": clock(rows, 0.1),
        "u": u,
        "y": 300 + 2 * noisy(first_order(u, 15, 1), 0.02),
    }


def written(folder: Path, table: dict[str, FloatArray], spec: str = SPEC) -> Path:
    lines = [",".join(table)]
    for row in zip(*table.values(), strict=True):
        lines.append(",".join("" if np.isnan(v) else repr(float(v)) for v in row))
    (folder / "data.csv").write_text("\n".join(lines) + "\n")
    path = folder / "plant.msnn.yaml"
    path.write_text(spec)
    return path


def looked_at(folder: Path, table: dict[str, FloatArray], spec: str = SPEC) -> DataCheck:
    return check_data(load_model(written(folder, table, spec)))


def said(check: DataCheck) -> dict[str, str]:
    """The text of each finding by its code."""
    return {d.code: " ".join((d.message, *d.notes, d.help or "")) for d in check.findings}


def test_clean_data_have_no_findings(tmp_path: Path):
    assert said(looked_at(tmp_path, columns())) == {}


def uneven(table: dict[str, FloatArray]) -> None:
    table["time"] += 0.003 * np.random.default_rng(0).normal(size=ROWS)


def with_gap(table: dict[str, FloatArray]) -> None:
    table["time"][1_000:] += 5


def twice(table: dict[str, FloatArray]) -> None:
    table["time"][100:] -= 0.1


def milliseconds(table: dict[str, FloatArray]) -> None:
    table["time"] *= 1000


def lacking(table: dict[str, FloatArray]) -> None:
    table["u"][[500, 501]] = np.nan


def spiked(table: dict[str, FloatArray]) -> None:
    table["y"][700] = 400


def cut(table: dict[str, FloatArray]) -> None:
    table["y"] = np.minimum(table["y"], 300.8)


def coarse(table: dict[str, FloatArray]) -> None:
    table["y"] = np.round(table["y"] * 10) / 10


def still(table: dict[str, FloatArray]) -> None:
    table["u"][:] = 2.5


def empty(table: dict[str, FloatArray]) -> None:
    table["y"][:] = np.nan


def celsius(table: dict[str, FloatArray]) -> None:
    table["y"] -= 273.15


def late(table: dict[str, FloatArray]) -> None:
    table["y"] = 300 + noisy(first_order(table["u"], 15, 4), 0.02)


def at_once(table: dict[str, FloatArray]) -> None:
    table["y"] = 300 + noisy(first_order(table["u"], 15, 0), 0.02)


def poor(table: dict[str, FloatArray]) -> None:
    table["u"] = multisine(ROWS, 2)


def slow(table: dict[str, FloatArray]) -> None:
    table["y"] = 300 + 5 * noisy(first_order(table["u"], 150, 1), 0.02)


def slow_inputs(table: dict[str, FloatArray]) -> None:
    table["u"] = held(ROWS, 0, 150, 300)
    slow(table)


def unmoved(table: dict[str, FloatArray]) -> None:
    table["y"] = 300 + np.random.default_rng(3).normal(size=ROWS)


@pytest.mark.parametrize(
    ("change", "code", "parts"),
    [
        (uneven, "W0810", ("data.csv", "`resample: linear` under `data:`")),
        (milliseconds, "W0811", ("100 s apart", "write `time: {column: time, unit: ms}`")),
        (with_gap, "W0812", ("5.1 s before row 1000", "`resample: none`")),
        (
            twice,
            "W0813",
            ("data.csv has rows that are at the time of the row before: one, row 100",),
        ),
        (lacking, "W0814", ("2 of 3000", "`u`", "row 500 of data.csv", "`nan: split`")),
        (spiked, "W0815", ("a spike", "row 700 of data.csv", " K")),
        (
            cut,
            "W0816",
            ("largest value 300.8 K", "`filter: y < 300.8`", "as a reference does, may stay"),
        ),
        (coarse, "W0817", ("steps of 0.1 K", "`validate:`")),
        (still, "W0818", ("`u` is 2.5 V in every row of data.csv", "`inputs:`")),
        (empty, "W0818", ("`y` has no values in data.csv",)),
        (celsius, "W0819", ("below −120 °C", "unit: degC")),
        (late, "W0820", ("after 4 rows (0.4 s)", "read `u[t-3]`")),
        (at_once, "W0820", ("in the same row", "`between: linear` at `u`", "`predicts: y[t]`")),
        (poor, "W0821", ("`u` excites ", "Hz")),
        (slow_inputs, "W0822", ("sample times; 10 to 30", "`every: ")),
        (slow, "W0824", ("40 rows", "`train.0.rollout.horizon: ")),
        (unmoved, "W0827", ("`y` shows no response to `u` within 100 rows (joint test: p = ",)),
    ],
)
def test_a_fault_is_told_with_its_place_and_its_repair(
    change: object, code: str, parts: tuple[str, ...], tmp_path: Path
):
    table = columns()
    assert callable(change)
    change(table)
    found = said(looked_at(tmp_path, table))
    assert code in found
    for part in parts:
        assert part in found[code]


@pytest.mark.parametrize("key", ["time: {column: time, unit: ms}", "time: {column: 0, unit: ms}"])
def test_a_unit_of_time_that_is_not_the_files_is_named(key: str, tmp_path: Path):
    """3000 rows are 0.3 s then: `every: 1000` would take three of them."""
    text = said(looked_at(tmp_path, columns(), SPEC.replace("time: time", key)))["W0811"]
    repaired = key.replace("ms", "s")
    assert f"if the time is in s, write `{repaired}`; else `every: 1000`" in text
    assert "W0811" not in said(looked_at(tmp_path, columns(), SPEC.replace("time: time", repaired)))


def test_a_window_that_is_too_short(tmp_path: Path):
    """A step response of 15 rows settles to 2 % in 15 ln 50 = 59 rows."""
    spec = SPEC.replace("expr: from_y(y) + from_u(u)", "expr: from_u(u)")
    spec = spec.replace("from_y: {fir: {window: 3}}, ", "")
    text = said(looked_at(tmp_path, columns(), spec))["W0823"]
    assert "reads 3 rows of `u`" in text
    assert "`layers.from_u.fir.window: " in text
    assert 50 < int(text.split("takes ")[1].split()[0]) < 70


def test_feedback_and_dependence(tmp_path: Path):
    spec = SPEC.replace("u: {unit: V}", "u: {unit: V}, w: {unit: V}")
    spec = spec.replace("from_u(u),", "from_u(u) + from_u(w),")
    table = columns()
    reference, random = held(ROWS, 4, 30, 90), np.random.default_rng(2)
    y, u = np.zeros(ROWS), np.zeros(ROWS)
    for t in range(1, ROWS):
        y[t] = 0.9 * y[t - 1] + 0.1 * u[t - 1] + 0.02 * random.normal()
        u[t] = 2 * (reference[t] - y[t - 1])
    table |= {"u": u, "y": 300 + y, "w": 3 * u}
    found = said(looked_at(tmp_path, table, spec))
    assert "past values of `y` help to predict `" in found["W0825"]
    assert "`w` = 3 u, to 100.00 %" in found["W0826"]


def test_a_smooth_input_without_controller_is_not_blamed_on_one(tmp_path: Path):
    """The target shows how an input moves between rows, in open loop: no controller is claimed."""
    table, random = columns(), np.random.default_rng(0)
    fine = np.convolve(random.normal(size=10 * ROWS + 29), np.hanning(30), "valid")
    y = first_order(fine, 100, 1)[::10]
    table |= {"u": fine[::10], "y": 300 + noisy(y, 0.002, 2)}
    found = looked_at(tmp_path, table)
    text = said(found)["W0825"]
    assert "a controller computes `u` from `y`, or `u` is held or changes smoothly" in text
    assert "with a controller, predict one step" in text
    assert "predicted by target" in check_tables(found)


def test_the_advice_is_weaker_where_the_recording_is_short(tmp_path: Path):
    """Of 300 rows of noise a third of the deviation may be an effect; of 20,000 rows little."""
    table = columns(300)
    table["y"] = 300 + np.random.default_rng(3).normal(size=300)
    short = said(looked_at(tmp_path, table))["W0827"]
    assert "cannot exclude a static effect on `y`" in short
    assert "keep `u`" in short
    assert "out of `inputs:`" not in short
    table = columns(20_000)
    table["y"] = 300 + np.random.default_rng(3).normal(size=20_000)
    long = said(looked_at(tmp_path, table))["W0827"]
    assert "of the deviation of `y` is unlikely" in long
    assert "take what has no influence out of `inputs:`" in long


def with_set_point(rows: int = ROWS) -> dict[str, FloatArray]:
    """A first-order plant under an integrating controller that reads the row before."""
    reference, random = held(rows, 4, 30, 90), np.random.default_rng(2)
    y, u, total = np.zeros(rows), np.zeros(rows), 0.0
    for t in range(1, rows):
        y[t] = 0.9 * y[t - 1] + 0.1 * u[t - 1] + 0.02 * random.normal()
        error = reference[t] - y[t - 1]
        total += 0.05 * error
        u[t] = 2 * error + total
    return {"time": clock(rows, 0.1), "u": u, "w": reference, "y": 300 + y}


WITH_W = SPEC.replace("u: {unit: V}", "u: {unit: V}, w: {unit: K}").replace(
    "from_u(u),", "from_u(u) + from_u(w),"
)


def test_a_set_point_is_told_with_its_controller(tmp_path: Path):
    found = looked_at(tmp_path, with_set_point(), WITH_W)
    text = said(found)["W0847"]
    assert "`w` is the set-point of `y`: a controller computes `u` from" in text
    assert "its errors on this recording may rise" in text
    assert "W0827" not in said(found)
    record = check_record(found)["system"]["targets"][0]["inputs"]
    assert [(one["set_point"], one["controller"]) for one in record] == [(False, None), (True, "u")]
    assert record[0]["p_value"] < 1e-9
    repaired = SPEC
    assert "W0847" not in said(looked_at(tmp_path, with_set_point(), repaired))


def test_a_set_point_without_its_controller_needs_a_name(tmp_path: Path):
    table = with_set_point()
    spec = SPEC.replace("u: {unit: V}", "NAME: {unit: K}").replace("from_u(u)", "from_u(NAME)")
    for name, told in (("w", False), ("y_set", True), ("set_size", False), ("offset", False)):
        one = {"time": table["time"], name: table["w"], "y": table["y"]}
        assert ("W0847" in said(looked_at(tmp_path, one, spec.replace("NAME", name)))) == told


@pytest.mark.parametrize(("step", "is_target"), [(0.6, True), (0.4, True), (0.6, False)])
def test_few_levels_are_rounding_of_a_target_and_a_switch_of_an_input(
    step: float, is_target: bool, tmp_path: Path
):
    table = columns()
    name = "y" if is_target else "u"
    table[name] = np.round(table[name] / step) * step
    assert 3 <= len(np.unique(table[name])) <= 16
    found = said(looked_at(tmp_path, table))
    assert ("W0817" in found) == is_target
    if is_target:
        assert f"`y` has steps of {step} K" in found["W0817"]
        assert "ignore this if `y` is switched" in found["W0817"]


def test_a_target_that_is_on_or_off_is_not_rounded(tmp_path: Path):
    table = columns()
    table["y"] = np.where(table["y"] > 300, 301.0, 300.0)
    assert "W0817" not in said(looked_at(tmp_path, table))


def test_rows_are_not_left_out_where_an_input_moves_between_them(tmp_path: Path):
    table = columns()
    slow(table)
    assert "W0822" not in said(looked_at(tmp_path, table))


def test_a_range_without_width_is_not_printed(tmp_path: Path):
    table = columns()
    table["y"] = 300 + first_order(table["u"], 15, 1)
    found = looked_at(tmp_path, table)
    assert "not known" in check_tables(found)
    slowest = check_record(found)["system"]["targets"][0]["slowest"]
    assert slowest["value"] == pytest.approx(1.5, rel=1e-3)
    assert (slowest["low"], slowest["high"]) == (None, None)


def test_lost_rows_are_counted(tmp_path: Path):
    table = columns()
    kept = np.ones(ROWS, np.bool_)
    kept[[500, 501, 502, 900]] = False
    found = looked_at(tmp_path, {name: values[kept] for name, values in table.items()})
    assert found.datasets[0].sampling[0].lost == 4
    assert check_record(found)["datasets"][0]["files"][0]["lost"] == 4


def test_a_range_of_which_the_data_know_little(tmp_path: Path):
    spec = SPEC.replace("unit: V}", "unit: V, range: [-20, 20]}")
    assert "5% of its range" in said(looked_at(tmp_path, columns(), spec))["W0828"]


def test_a_range_that_the_data_leave(tmp_path: Path):
    spec = SPEC.replace("unit: V}", "unit: V, range: [-0.5, 0.5]}")
    assert "outside its range" in said(looked_at(tmp_path, columns(), spec))["W0801"]


@pytest.mark.parametrize("rows", [1, 2, 3, 12, 40])
def test_few_rows_are_told_and_break_nothing(rows: int, tmp_path: Path):
    table = columns()
    found = looked_at(tmp_path, {name: values[50 : 50 + rows] for name, values in table.items()})
    assert found.system is not None
    assert not {"W0821", "W0822", "W0824"} & set(said(found))
    assert ("W0829" in said(found)) == (rows == 12)


@pytest.mark.parametrize(("part", "is_enough"), [(15, False), (35, True)])
def test_many_short_parts_are_too_few_only_if_none_has_enough_rows(
    part: int, is_enough: bool, tmp_path: Path
):
    table = columns(560)
    table["time"] += 9 * (np.arange(560) // part)
    found = said(looked_at(tmp_path, table))
    assert ("W0829" not in found) == is_enough
    if not is_enough:
        assert "the longest part without gap, 15 of 560 rows" in found["W0829"]
        assert "30 rows in one part are enough" in found["W0829"]


@pytest.mark.parametrize("key", ["nan: split", "nan: drop", "resample: linear, nan: split"])
def test_a_key_that_the_spec_has_is_not_advised(key: str, tmp_path: Path):
    table = columns()
    table["u"][[500, 501]] = np.nan
    found = looked_at(tmp_path, table, SPEC.replace("time: time}", f"time: time, {key}}}"))
    text = said(found)["W0814"]
    assert f"`{key.rsplit(', ')[-1]}` already" in text
    assert "under `data:` ends" not in text
    model = load_model(tmp_path / "plant.msnn.yaml")
    assert model.spec.data is not None
    load_data(model.program, model.spec.data, tmp_path)


def test_resampling_does_not_accept_missing_inputs(tmp_path: Path):
    """Training stops at an empty cell of an input, so the help names the key that is missing."""
    table = columns()
    table["u"][[500, 501]] = np.nan
    spec = SPEC.replace("time: time}", "time: time, resample: linear}")
    text = said(looked_at(tmp_path, table, spec))["W0814"]
    assert "training stops there (E0809): `nan: split` under `data:`" in text
    model = load_model(tmp_path / "plant.msnn.yaml")
    assert model.spec.data is not None
    with pytest.raises(SpecError) as error:
        load_data(model.program, model.spec.data, tmp_path)
    assert {one.code for one in error.value.diagnostics} == {"E0809"}


def test_everything_at_once_breaks_nothing(tmp_path: Path):
    table = columns()
    for change in (uneven, with_gap, lacking, spiked, cut, still):
        change(table)
    table["y"][:1_400] = np.nan
    assert {"W0810", "W0812", "W0814", "W0818"} <= set(said(looked_at(tmp_path, table)))


def test_resampled_data_are_looked_at_as_recorded_and_at_the_sample_time(tmp_path: Path):
    table = columns()
    table["time"] /= 2
    spec = SPEC.replace("time: time}", "time: time, resample: linear}")
    found = looked_at(tmp_path, table, spec)
    assert found.datasets[0].sampling[0].step == pytest.approx(0.05)
    assert found.system is not None
    assert found.system.step == 0.1
    assert "W0811" not in said(found)


RESAMPLED = SPEC.replace("time: time}", "time: time, resample: linear MORE}")


@pytest.mark.parametrize("jitter", [0.0, 0.02])
def test_data_are_joined_as_validate_joins_them(tmp_path: Path, jitter: float):
    """Files that follow after 1.3 steps, or with uneven rows: `resample:` joins them."""
    table = columns(900)
    table["time"] += jitter * np.random.default_rng(3).uniform(-1, 1, 900)
    table["time"][300:] += 0.03
    spec = RESAMPLED.replace("data.csv", "part_*.csv").replace(" MORE", ", join: true, from: 400")
    for k in range(3):
        part = {name: values[300 * k : 300 * (k + 1)] for name, values in table.items()}
        written(tmp_path, part, spec)
        (tmp_path / "data.csv").rename(tmp_path / f"part_{k}.csv")
    model = load_model(tmp_path / "plant.msnn.yaml")
    found = check_data(model)
    assert "W0832" not in said(found)
    assert len(found.datasets[0].rows.records) == 1
    # `from` counts rows of all files
    assert found.datasets[0].rows.follows.sum() + 2 >= 500
    assert model.spec.data is not None
    assert len(load_data(model.program, model.spec.data, tmp_path).records) == 1


def test_rows_that_a_filter_leaves_out_are_not_missing(tmp_path: Path):
    spec = SPEC.replace("time: time}", 'time: time, nan: split, filter: "y > 301"}')
    table = columns()
    assert "W0814" not in said(looked_at(tmp_path, table, spec))
    kept = np.flatnonzero(table["y"] > 301)
    table["u"][kept[5]] = np.nan
    found = looked_at(tmp_path, table, spec)
    assert f"1 of {len(kept)} values of `u` are missing" in said(found)["W0814"]


def test_cells_between_values_of_a_slower_column_are_not_missing(tmp_path: Path):
    """A table of two rates, which `resample:` is for; a value that is lost is missing."""
    table = columns()
    table["u"][np.arange(ROWS) % 5 != 0] = np.nan
    spec = RESAMPLED.replace(" MORE", "")
    table["time"][1::5] += 0.03
    found = said(looked_at(tmp_path, table, spec))
    assert not found.keys() & {"W0814", "W0810"}
    table["u"][600] = np.nan
    assert "9 of 3000 values of `u` are missing" in said(looked_at(tmp_path, table, spec))["W0814"]


def test_a_static_model_has_columns_and_no_system(tmp_path: Path):
    spec = "msnn: 1\nname: plant\ninputs: {u: V}\ntargets: {y: K}\noutputs: {z: 2 * u}\n"
    spec += 'losses: {l: "mse(z, y)"}\ndata: {source: {train: data.csv}}\n'
    found = looked_at(tmp_path, columns(), spec)
    assert found.system is None
    assert [one.channel.name for one in found.datasets[0].channels] == ["u", "y"]


def test_elements_of_vectors_are_columns(tmp_path: Path):
    spec = SPEC.replace("u: {unit: V}", "u: {unit: V, dims: [axis]}") + "dims: {axis: 2}\n"
    spec = spec.replace("from_u(u)", "sum(from_u(u))").replace(
        "{train: data.csv}", "{train: data.csv}, columns: {u: [u, v]}"
    )
    table = columns()
    table |= {"v": held(ROWS, 9)}
    table["v"][30] = np.nan
    found = looked_at(tmp_path, table, spec)
    assert [one.channel.name for one in found.datasets[0].channels] == ["u[0]", "u[1]", "y"]
    assert "`u[1]`" in said(found)["W0814"]


def test_text_among_the_numbers_is_an_error_as_everywhere(tmp_path: Path):
    path = written(tmp_path, columns(20))
    (tmp_path / "data.csv").write_text("time,u,y\n0,1,2\n0.1,on,3\n")
    with pytest.raises(SpecError, match="E0807"):
        check_data(load_model(path))


def test_a_spec_without_data_is_an_error(tmp_path: Path):
    path = written(tmp_path, columns(20), "msnn: 1\nname: a\ninputs: {u: V}\noutputs: {y: u}\n")
    with pytest.raises(SpecError, match="E1039"):
        check_data(load_model(path))


def test_every_finding_is_tested_here():
    named = Path(__file__).read_text()
    assert [c for c in known_codes() if "W0810" <= c <= "W0829" and c not in named] == []


def test_the_command_prints_tables_and_writes_both_files(msnn: CommandLine, tmp_path: Path):
    table = columns()
    spiked(table)
    path = written(tmp_path, table)
    done = msnn("data", path, "--json", "found.json", "--plot", "found.png")
    assert done.code == 0
    assert "warning[W0815]: `y` has a spike" in done.err
    assert "input  99 % of its power / Hz" in done.out
    record = json.loads((tmp_path / "found.json").read_text())
    assert (record["version"], record["command"]) == (1, "data")
    assert record["datasets"][0]["columns"][1]["spikes"][0]["place"] == "row 700 of data.csv"
    assert record["system"]["targets"][0]["inputs"][0]["delay"] == 1
    assert record["findings"][0]["code"] == "W0815"
    assert (tmp_path / "found.png").read_bytes().startswith(b"\x89PNG")


def test_the_command_looks_at_other_files(msnn: CommandLine, tmp_path: Path):
    path = written(tmp_path, columns())
    table = columns()
    with_gap(table)
    written(tmp_path, table)
    (tmp_path / "data.csv").rename(tmp_path / "other.csv")
    done = msnn("data", path, "--data", "other.csv")
    assert done.code == 0
    assert "W0812" in done.err
    assert msnn("data", path).code == 1


def test_check_warns_of_data_when_asked(msnn: CommandLine, tmp_path: Path):
    table = columns()
    with_gap(table)
    path = written(tmp_path, table)
    assert "W0812" not in msnn("check", path).err
    done = msnn("check", path, "--data")
    assert done.code == 0
    assert "W0812" in done.err


def test_a_run_that_was_moved_says_where_it_had_its_data(
    msnn: CommandLine, project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    assert msnn("train", "plant.msnn.yaml", "--set", "train.0.epochs=1").code == 0
    assert msnn("data", "runs/plant/latest").code == 0
    (project / "runs/plant/latest").resolve().rename(tmp_path / "run")
    project.rename(tmp_path / "elsewhere")
    monkeypatch.chdir(tmp_path)
    said = msnn("data", "run")
    assert said.code == 1
    assert "the run does not keep its data" in said.err
    assert msnn("data", "run", "--data-root", "elsewhere").code == 0
