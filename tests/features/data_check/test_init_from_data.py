"""`msnn init NAME --data FILE` makes a spec that checks clean, trains and predicts."""

from __future__ import annotations

import re
import shlex
import subprocess
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.data import first_models
from msnn.api import measurements, models, trainings
from msnn.data.dataset import FloatArray
from msnn.features.data_check.first_spec.columns import columns_of
from msnn.features.data_check.first_spec.new_spec import TargetNotNamedError, spec_from_data
from msnn.features.data_check.first_spec.recordings import on_times
from msnn.features.data_check.first_spec.time_column import time_of
from msnn.model.model_data import read_data
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.editors.format_spec import format_spec
from tests.cli.command_line import CommandLine
from tests.features.data_check.systems import clock, first_order, held, noisy

ROWS = 600
STEP = 0.1


def table() -> dict[str, FloatArray]:
    u, w = held(ROWS, 1), held(ROWS, 2)
    y = 20 + first_order(u, 12, 3) - 0.5 * first_order(w, 12, 1)
    return {"t": clock(ROWS, STEP), "u": u, "w": w, "y": noisy(y - 20, 0.02) + 20}


def text(
    columns: dict[str, FloatArray],
    header: str | None,
    *,
    delimiter: str = ",",
    decimal: str = ".",
    above: str = "",
    below: str = "",
) -> str:
    rows = zip(*columns.values(), strict=True)
    lines = [delimiter.join(f"{v:.6g}".replace(".", decimal) for v in row) for row in rows]
    return above + "\n".join(
        [*([] if header is None else [header]), *([below] if below else []), *lines, ""]
    )


@pytest.mark.parametrize(("step", "is_hole"), [(0.2, False), (0.24, False), (0.3, True)])
def test_a_new_spec_fills_the_steps_that_its_data_section_fills(step: float, is_hole: bool):
    even = np.asarray(np.arange(10) * STEP, np.float64)
    time = np.append(even, 0.9 + step + even)
    values = np.asarray(3 * time, np.float64)
    grid = np.arange(0.0, time[-1], STEP)
    between = (grid > 0.9 + 1e-9) & (grid < 0.9 + step - 1e-9)
    found = on_times(time, values, grid, STEP)
    assert np.isnan(found[between]).all() == is_hole
    assert found[~between] == pytest.approx(3 * grid[~between])


DIALECTS = {
    "plain": text(table(), "time,u,w,y"),
    "units in brackets": text(table(), "time [s],u [V],w [N*m],y [degC]"),
    "units in parentheses": text(table(), "Time (s),u (V),w (Nm),y (°C)"),
    "a line of units": text(table(), "time,u,w,y", below="s,V,N,K"),
    "semicolons and commas": text(table(), "Zeit;u;w;y", delimiter=";", decimal=","),
    "tabs": text(table(), "t\tu\tw\ty", delimiter="\t"),
    "bars": text(table(), "t|u|w|y", delimiter="|"),
    "no header": text(table(), None),
    "lines above": text(table(), "t,u,w,y", above="Logger 7\nserial 123\n\n"),
    "comments": text(table(), "t,u,w,y", above="# made by a logger\n"),
    "header as a comment": text(table(), "# t,u,w,y"),
    "milliseconds": text(table() | {"t": clock(ROWS, 100)}, "time_ms,u,w,y"),
    "milliseconds by plausibility": text(table() | {"t": clock(ROWS, 100)}, "time,u,w,y"),
    "no time": text({k: v for k, v in table().items() if k != "t"}, "u,w,y"),
    "a counter": text(table() | {"t": clock(ROWS, 1)}, "index,u,w,y"),
    "names of sections": text(table(), "time,offset,linear,y"),
    "a byte order mark": "\ufeff" + text(table(), "time,u,w,y"),
}


def folder_of(tmp_path: Path, content: str, predict: str, name: str = "plant") -> Path:
    (tmp_path / "my.csv").write_text(content, encoding="utf-8")
    spec = spec_from_data(name, tmp_path / "my.csv", tmp_path, predict)
    (tmp_path / "plant.msnn.yaml").write_text(spec.text, encoding="utf-8")
    return tmp_path / "plant.msnn.yaml"


def predicted(content: str) -> str:
    """The name of the last column, which is what is predicted in these files."""
    first = next(
        line for line in content.lstrip("\ufeff").splitlines() if "y" in line or "0" in line
    )
    return "y" if "y" in first else "column_3"


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_new_spec_checks_clean_trains_and_beats_a_constant_and_a_hold(
    dialect: str, tmp_path: Path
):
    content = DIALECTS[dialect]
    name = "column_3" if dialect == "no header" else "y"
    path = folder_of(tmp_path, content, name)
    model = models.load(path)
    assert model.warnings == ()
    assert format_spec(str(path), path.read_text()) == path.read_text()
    trained = trainings.train(model, runs=None)
    report = measurements.validate(model, trained.weights)
    one_step, free = report.rows
    late = table()["y"][int(0.8 * ROWS) :]
    assert one_step.value < 0.95 * np.sqrt(np.mean(np.diff(late) ** 2))
    # noise of 2 % is left of a signal that a constant misses by all of its deviation
    assert free.value < 0.15 * np.std(late)


def test_what_a_spec_says_of_its_file(tmp_path: Path):
    path = folder_of(tmp_path, DIALECTS["units in parentheses"], "y")
    spec = path.read_text()
    assert "sample_time: 100 ms" in spec
    assert 'time: {column: "Time (s)"}' in spec
    assert 'y: {column: "y (°C)", unit: degC}' in spec
    assert re.search(r"u: \{unit: V, range: \[-[01]\.\d+, [01]\.\d+\], doc: \"u \(V\)\"\}", spec)
    assert "from_u(u[t-2]) + from_w(w) + offset" in spec
    assert re.search(
        r"from_u: \{fir: \{window: 1, init: \[0\.0[78]\d*\]\}\}  # answers after 3 rows, 300 ms",
        spec,
    )
    assert "split: {by: fraction, val: 0.2}" in spec
    assert "# put the equation you know here" in spec


@pytest.mark.parametrize(
    ("written", "unit"),
    [
        ("°/s", "deg/s"),
        ("Nm", "N*m"),
        ("m/s²", "m/s^2"),
        ("N/(m/s)", "N*s/m"),
        ("%", "%"),
        ("-", None),
        ("Foo", None),
    ],
)
def test_units_as_people_write_them(written: str, unit: str | None, tmp_path: Path):
    path = folder_of(tmp_path, text(table(), f"time,u [{written}],w,y"), "y")
    found = models.load(path).program.signal("u").unit
    assert (None if found is None else found.text) == unit


def test_a_column_may_be_named_as_the_header_has_it(tmp_path: Path):
    assert (
        "predicts: y[t+1]"
        in folder_of(tmp_path, DIALECTS["units in brackets"], "y [degC]").read_text()
    )


@pytest.mark.parametrize(
    ("header", "times", "unit", "step", "told"),
    [
        ("time", 0.01 * np.arange(50), "s", 0.01, ""),
        ("t", 10.0 * np.arange(50), "ms", 0.01, "time is taken as ms"),
        ("time", 60.0 * np.arange(50), "s", 60, "time is taken as s"),
        ("Timestamp", 1.7e9 + np.arange(50), "s", 1, "time is taken as s"),
        ("timestamp", 1.7e12 + 20.0 * np.arange(50), "ms", 0.02, "since 1970"),
        ("t_us", 500.0 * np.arange(50), "us", 5e-4, ""),
        ("Elapsed [min]", 1.0 * np.arange(50), "min", 60, ""),
        ("millis", 5.0 * np.arange(50), "ms", 0.005, ""),
        ("x", 0.5 * np.arange(50), "s", 0.5, ""),
    ],
)
def test_the_unit_of_time(
    header: str, times: FloatArray, unit: str, step: float, told: str, tmp_path: Path
):
    lines = [f"{header},y", *(f"{t!r},{np.sin(i)}" for i, t in enumerate(times.tolist()))]
    (tmp_path / "my.csv").write_text("\n".join(lines))
    found = time_of(columns_of(tmp_path / "my.csv"), "my.csv")
    assert (found.unit, found.step) == (unit, pytest.approx(step))
    assert told in " ".join(found.notes)
    assert found.column is not None


def test_uneven_and_broken_times_are_dealt_with(tmp_path: Path):
    columns = table()
    columns["t"][300:] += 7
    path = folder_of(tmp_path, text(columns, "t,u,w,y"), "y")
    assert "resample: none" in path.read_text()
    columns["t"] += 0.01 * np.random.default_rng(0).normal(size=ROWS)
    assert "resample: linear" in folder_of(tmp_path, text(columns, "t,u,w,y"), "y").read_text()
    columns["t"][400] = 0
    spec = folder_of(tmp_path, text(columns, "t,u,w,y"), "y").read_text()
    assert "`t` of my.csv does not rise at row 400 (" in spec
    assert "sort the rows by it" in " ".join(spec.split("\n# "))
    assert "  time:" not in spec
    assert "from_t" not in spec  # a time is no input, whatever is wrong with it


@pytest.mark.parametrize("again", [0.0, 29.9])
def test_a_clock_that_is_set_back_begins_anew(again: float, tmp_path: Path):
    """The time became an input of the model, and rows of two records became neighbours."""
    columns = table()
    columns["t"][300:] += again - columns["t"][300]
    path = folder_of(tmp_path, text(columns, "t,u,w,y"), "y")
    spec = path.read_text()
    assert f"`t` of my.csv does not rise at row 300 (29.9, then {again:.6g}): `resample:" in spec
    model = models.load(path)
    assert {signal.name for signal in model.program.signals} == {"u", "w", "y"}
    data = read_data(model, None, "training")
    assert np.flatnonzero(~data.continues).tolist() == [0, 300]


def test_a_time_that_falls_is_told_with_its_repair(tmp_path: Path):
    columns = table() | {"t": clock(ROWS, STEP)[::-1]}
    with pytest.raises(SpecError, match=r"E1130.*falls from row to row"):
        folder_of(tmp_path, text(columns, "t,u,w,y"), "y")


@pytest.mark.parametrize(
    ("value", "told"), [(3.0, "`y` is 3 in every row"), (np.nan, "`y` has no number in any row")]
)
def test_a_target_that_does_not_move_is_told(value: float, told: str, tmp_path: Path):
    content = text(table() | {"y": np.full(ROWS, value)}, "t,u,w,y")
    with pytest.raises(TargetNotNamedError, match=told):
        folder_of(tmp_path, content, "y")
    with pytest.raises(TargetNotNamedError, match="without any change: y; say which one"):
        spec_from_data("plant", tmp_path / "my.csv", tmp_path, None)


def test_a_target_of_text_is_told_with_the_text(tmp_path: Path):
    """A logger's own word for a missing value made a column unknown without a reason."""
    rows = text(table(), "t,u,w,y [K]").splitlines()
    rows[37] = rows[37].rpartition(",")[0] + ",---"
    with pytest.raises(TargetNotNamedError, match="`y` is no column of numbers, `---` stands in"):
        folder_of(tmp_path, "\n".join(rows), "y")


def test_dates_give_the_sample_time(tmp_path: Path):
    lines = ["date,u,y"]
    lines += [f"2024-05-01T10:{i // 60:02}:{i % 60:02},{i % 7},{np.sin(i)}" for i in range(300)]
    spec = folder_of(tmp_path, "\n".join(lines), "y").read_text()
    assert "sample_time: 1 s" in spec
    assert re.search(r"time: .*date", spec)
    (run,) = measurements.simulate(models.load(tmp_path / "plant.msnn.yaml"))
    assert run.places.time is not None


@pytest.mark.parametrize("days", [1, 2])
def test_days_without_a_time_of_day_are_no_time(days: int, tmp_path: Path):
    file = tmp_path / "log.csv"
    rows = (f"2026-11-{22 + days * row // 300},17:00:00,{row % 7},{row % 5}" for row in range(300))
    file.write_text("\n".join(["date,clock,u,y", *rows]))
    found = time_of(columns_of(file), "my.csv")
    assert (found.column, found.step) == (None, 1.0)
    assert "put both into one column" in found.notes[0]


def test_days_are_the_time_of_rows_that_are_days_apart(tmp_path: Path):
    file = tmp_path / "log.csv"
    rows = (f"2026-11-{row:02},{row % 7},{row % 5}" for row in range(1, 29))
    file.write_text("\n".join(["date,u,y", *rows]))
    assert time_of(columns_of(file), "my.csv").step == 86400.0


def test_a_workbook_makes_a_spec(tmp_path: Path):
    book = openpyxl.Workbook()
    sheet: Any = book.active
    sheet.append(["date", "u [V]", "y"])
    for i in range(300):
        when = datetime(2026, 5, 1, 10, i // 60, i % 60)
        sheet.append([when, float(i % 7), float(np.sin(i))])
    book.save(tmp_path / "log.xlsx")
    spec = spec_from_data("plant", tmp_path / "log.xlsx", tmp_path, "y")
    (tmp_path / "plant.msnn.yaml").write_text(spec.text, encoding="utf-8")
    (run,) = measurements.simulate(models.load(tmp_path / "plant.msnn.yaml"))
    assert "u: {unit: V" in spec.text
    assert run.places.time is not None


@pytest.mark.parametrize(
    ("header", "formats", "unit", "note"),
    [
        ("u", ['0.0 "km/h"'], "km/h", None),
        ("u", [r"0.0\ \°\C"], "degC", None),
        ("u", ['0.0, "kN"'], "N", None),
        ("u [kN]", ['0.0, "kN"'], "N", None),
        # the ratio itself
        ("u", ["0.0%"], None, None),
        ("u", ['0.0 "km/h"', '0.0 "m/s"'], None, "may be in km/h or m/s"),
        ("u [kN]", ["0.0,"], None, "may be in kN or N"),
        ("u [gm]", ["0.0"], None, None),
        ("u [cc]", ["0.0"], None, None),
        ("u [Nl/min]", ["0.0"], None, None),
    ],
)
def test_number_formats_of_a_workbook_state_units(
    tmp_path: Path, header: str, formats: list[str], unit: str | None, note: str | None
):
    book = openpyxl.Workbook()
    sheet: Any = book.active
    sheet.append(["time [s]", header, "y"])
    for i in range(300):
        sheet.append([i / 10, float(i % 7), float(np.sin(i))])
        sheet.cell(i + 2, 2).number_format = formats[i % len(formats)]
    book.save(tmp_path / "log.xlsx")
    spec = spec_from_data("plant", tmp_path / "log.xlsx", tmp_path, "y")
    (tmp_path / "plant.msnn.yaml").write_text(spec.text, encoding="utf-8")
    assert measurements.simulate(models.load(tmp_path / "plant.msnn.yaml"))
    declared = next(line for line in spec.text.splitlines() if line.startswith("  u: {"))
    assert (f"unit: {unit}," in declared) if unit else ("unit" not in declared), declared
    assert any(note in said for said in spec.notes) if note else not spec.notes


def test_blanks_between_cells_make_a_spec(tmp_path: Path):
    lines = ["time [s]   u [V]   y [m]"]
    lines += [f"{i / 10:8.2f} {i % 7:6d}   {np.sin(i):9.5f}" for i in range(300)]
    path = folder_of(tmp_path, "\n".join(lines), "y")
    (run,) = measurements.simulate(models.load(path))
    assert "# u has no visible effect in these data" in path.read_text()
    assert "y: {unit: m" in path.read_text()
    assert "sample_time: 100 ms" in path.read_text()
    assert run.places.time is not None


def test_missing_inputs_end_the_episode(tmp_path: Path):
    content = DIALECTS["plain"].splitlines()
    content[200] = re.sub(r",[^,]*,", ",,", content[200], count=1)
    path = folder_of(tmp_path, "\n".join(content), "y")
    assert "nan: split" in path.read_text()
    trainings.train(models.load(path), runs=None)


@pytest.mark.filterwarnings("error")
def test_what_is_measured_seldom_is_no_input(tmp_path: Path):
    """A laboratory's samples: with them as an input no episode would have two rows."""
    rows = text(table(), "t,u,w,y").splitlines()
    rows = [f"{row},{k if k % 5 == 1 else ''}" for k, row in enumerate(rows)]
    rows[0] = rows[0][:-1] + ",z"
    path = folder_of(tmp_path, "\n".join(rows), "y")
    assert (
        f"# z has a value in {ROWS // 5} of {ROWS} rows: too few for an input" in path.read_text()
    )
    assert "from_z" not in path.read_text()
    trainings.train(models.load(path), runs=None)
    with pytest.raises(TargetNotNamedError, match=f"`z` has a value in {ROWS // 5} of {ROWS} rows"):
        folder_of(tmp_path, "\n".join(rows), "z")


def test_outputs_of_the_system_are_no_inputs_of_the_model(tmp_path: Path):
    columns = table()
    columns = {
        "t": columns["t"],
        "u": columns["u"],
        "z": first_order(columns["u"], 5, 1),
        "y": columns["y"],
    }
    spec = folder_of(tmp_path, text(columns, "t,u,z,y"), "y").read_text()
    assert "# z looks like an output too" in spec
    assert "from_z" not in spec


HOSTILE = [
    'say "hi"',
    "{a..b}",
    "tau{1..3}",
    "yes",
    "null",
    "!!python/object",
    "&anchor",
    "*alias",
    "# no comment",
    "a: b",
    "- item",
    "{% for x in y %}",
    "{{ 7 * 7 }}",
    "x" * 200,
    "温度",
    "Übergröße µ",
    "déjà vu",
    "e\u0301",
    "🚀",
    "sin",
    "class",
    "dt",
    "t",
    "1e5x",
    "-",
    "  ",
    "a'b",
    "a\\b",
    "u [no unit at all]",
    "\u202eabc",
]


@pytest.mark.parametrize("label", HOSTILE)
def test_hostile_headers_stay_text(label: str, tmp_path: Path):
    quoted = '"' + label.replace('"', '""') + '"'
    path = folder_of(tmp_path, text(table(), f"time,{quoted},w,y"), "y")
    model = models.load(path)
    assert model.warnings == ()
    assert read_data(model, None, "a test").rows == ROWS
    assert format_spec(str(path), path.read_text()) == path.read_text()


def test_columns_of_one_name_are_told_apart_by_their_index(tmp_path: Path):
    path = folder_of(tmp_path, text(table(), "time,a,a,y"), "y")
    assert "a: {column: 1}" in path.read_text()
    assert "a_2: {column: 2}" in path.read_text()
    assert read_data(models.load(path), None, "a test").rows == ROWS


LABELS = st.text(st.characters(exclude_characters="\r\n", exclude_categories=["Cs"]), max_size=30)


@given(labels=st.lists(LABELS, min_size=2, max_size=2))
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_any_header_gives_a_spec_that_reads_its_file(labels: list[str], tmp_path: Path):
    quoted = ",".join('"' + label.replace('"', '""') + '"' for label in labels)
    columns = {name: values[:80] for name, values in table().items()}
    path = folder_of(tmp_path, text(columns, f"zeit,{quoted},y_of_all"), "y_of_all")
    model = models.load(path)
    assert read_data(model, None, "a test").rows == 80


def test_without_a_target_the_candidates_are_named(msnn: CommandLine):
    Path("my.csv").write_text(DIALECTS["plain"])
    said = msnn("init", "plant", "--data", "my.csv")
    assert said.code == 2
    assert "outputs: y; like inputs: u, w" in said.err
    assert "--predict y" in said.err
    assert not Path("plant").exists()
    said = msnn("init", "plant", "--data", "my.csv", "--predict", "speed")
    assert said.code == 2
    assert "no column that moves is called `speed`" in said.err


def test_the_command_makes_a_folder_that_trains(msnn: CommandLine, monkeypatch: pytest.MonkeyPatch):
    Path("my.csv").write_text(DIALECTS["milliseconds by plausibility"])
    said = msnn("init", "plant", "--data", "my.csv", "--predict", "y")
    assert said.code == 0
    assert "note: time is taken as ms" in said.err
    assert sorted(p.name for p in Path("plant").iterdir()) == [
        ".gitignore",
        "README.md",
        "msnn.schema.json",
        "plant.msnn.yaml",
    ]
    assert msnn("check", "plant/plant.msnn.yaml").err == ""
    assert msnn("fmt", "--check", "plant/plant.msnn.yaml").code == 0
    monkeypatch.chdir("plant")
    assert msnn("train", "plant.msnn.yaml").code == 0
    assert msnn("data", "plant.msnn.yaml").code == 0


def test_nothing_is_overwritten(msnn: CommandLine):
    Path("my.csv").write_text(DIALECTS["plain"])
    Path("plant").mkdir()
    said = msnn("init", "plant", "--data", "my.csv", "--predict", "y")
    assert said.code == 1
    assert "E1034" in said.err
    assert list(Path("plant").iterdir()) == []


def test_predict_wants_data(msnn: CommandLine):
    assert msnn("init", "plant", "--predict", "y").code == 2


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ("", "E0803"),
        ("hello\nworld\n", "E0827"),
        ("time,y\n", "E0827"),
        ("time,y\n0,1\n1,1\n2,1\n3,1\n", "E0828"),
        ("time,y\n0,1\n1,2\n2,3\n3,1\n", "E0829"),
        ("time,y\n" + "".join(f"{i},{i % 5}\n" for i in range(900)) + "900,on\n", "E0807"),
    ],
)
def test_files_that_are_no_records_are_told(content: str, code: str, tmp_path: Path):
    with pytest.raises(SpecError, match=code):
        folder_of(tmp_path, content, "y")


def test_a_file_that_is_not_there(msnn: CommandLine):
    said = msnn("init", "plant", "--data", "none.csv", "--predict", "y")
    assert said.code == 1
    assert "none.csv" in said.err


def test_the_sample_project_gives_a_model_of_its_mass(made_project: Path, tmp_path: Path):
    """Orders above 1: a mass on a spring oscillates, a free run of first order misses it."""
    file = made_project / "data" / "train" / "run_01.csv"
    spec = spec_from_data("mass", file, tmp_path, "x").text
    (tmp_path / "mass.yaml").write_text(spec)
    model = models.load(tmp_path / "mass.yaml")
    report = measurements.validate(model, trainings.train(model, runs=None).weights)
    x = np.loadtxt(file, delimiter=",", skiprows=1)[160:, 2]
    assert report.rows[1].value < 0.1 * np.std(x)


DRONE = Path(__file__).resolve().parents[4] / "shared" / "data" / "quarter_drone"


@pytest.mark.skipif(not DRONE.is_dir(), reason="the records are not beside this checkout")
def test_records_of_a_real_drone_arm_in_closed_loop(tmp_path: Path):
    """The command of its controller is an input, its set-point is not; training improves both."""
    file = DRONE / "sinal4_multiseno_malha_fechada.csv"
    with pytest.raises(TargetNotNamedError, match="outputs: Saida_y; like inputs: Referencia"):
        spec_from_data("drone", file, tmp_path, None)
    spec = spec_from_data("drone", file, tmp_path, "Saida_y").text
    assert "from_Controle_u" in spec
    assert "# Referencia looks like the set-point of Saida_y, from which Controle_u is" in spec
    (tmp_path / "drone.yaml").write_text(spec)
    model = models.load(tmp_path / "drone.yaml")
    first = measurements.validate(model, None)
    report = measurements.validate(model, trainings.train(model, runs=None).weights)
    assert report.rows[1].value <= first.rows[1].value < 10
    assert not any(warning.code == "W0842" for warning in report.warnings)


def test_a_log_becomes_c_that_runs_by_what_the_readmes_say(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every command of the project's README, then the program and the line of the export's."""
    (msnn.folder / "log.csv").write_text(
        text(table(), "Zeit;u [V];w;y [°C]", delimiter=";"), encoding="utf-8"
    )
    made = msnn("init", "heater", "--data", "log.csv", "--predict", "y")
    assert made.code == 0, made.err
    folder = msnn.folder / "heater"
    commands = _blocks(folder / "README.md", "sh")[0].splitlines()
    monkeypatch.chdir(folder)
    for line in commands:
        verb, *arguments = shlex.split(line, comments=True)[1:]
        said = msnn(verb, *arguments)
        assert said.code == 0, said.err
    export = folder / "build" / "export" / "c"
    readme = (export / "README.md").read_text(encoding="utf-8")
    (export / "main.c").write_text(_blocks(export / "README.md", "c")[0], encoding="utf-8")
    compiles = next(line for line in readme.splitlines() if line.startswith("    cc "))
    subprocess.run(shlex.split(compiles), cwd=export, check=True)
    ran = subprocess.run([export / "a.out"], capture_output=True, text=True, check=True)
    assert ran.stdout.startswith("status 0 ")


def _blocks(page: Path, language: str) -> list[str]:
    found = re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.M)
    assert found, f"{page} has no block of {language}"
    return found


@pytest.mark.parametrize(
    ("header", "units", "notes"),
    [
        ("TIME [S],U [MV],W [MM],Y [KPA]", {"U": None, "W": "mm", "Y": "kPa"}, ["U"]),
        ("TIME [MS],U [V],W [L/MIN],Y [KN]", {"U": "V", "W": "L/min", "Y": None}, ["Y"]),
        ("time [s],U [MV],W [km/h],Y [MW]", {"U": "MV", "W": "km/h", "Y": "MW"}, []),
    ],
)
def test_a_unit_in_capitals_is_taken_where_it_is_one(
    tmp_path: Path, header: str, units: dict[str, str | None], notes: list[str]
) -> None:
    columns = table()
    columns["t"] = columns["t"] * (1000 if "MS" in header else 1)
    (tmp_path / "a.csv").write_text(text(columns, header))
    found = {c.name: c.unit and c.unit.text for c in columns_of(tmp_path / "a.csv").columns[1:]}
    assert found == units
    assert time_of(columns_of(tmp_path / "a.csv"), "a.csv").step == pytest.approx(STEP)
    made = spec_from_data("plant", tmp_path / "a.csv", tmp_path, "Y")
    assert [note.split("write the unit of ")[1].strip("`") for note in made.notes] == notes
    (tmp_path / "plant.msnn.yaml").write_text(made.text)
    model = models.load(tmp_path / "plant.msnn.yaml")
    values = read_data(model, None, "a test").series
    for name, column in zip(("U", "W", "Y"), ("u", "w", "y"), strict=True):
        assert values[name] == pytest.approx(columns[column], rel=1e-4)


@pytest.mark.parametrize("name", ["a.h5", "a.npz", "a.parquet", "a.mf4", "a.csv.gz"])
def test_a_file_that_init_does_not_read_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"\x1f\x8b\x08" if name.endswith("gz") else b"\x89HDF\r\n\x1a\n")
    with pytest.raises(SpecError) as caught:
        columns_of(tmp_path / name)
    (fault,) = caught.value.diagnostics
    assert fault.code == ("E0802" if name.endswith("gz") else "E0827")
    assert ("gzip -dc" if name.endswith("gz") else f"train: {name}") in str(fault.help)


def test_a_set_point_of_a_closed_loop_is_no_input(tmp_path: Path):
    """With random weights the free run was worse than a constant."""
    goal = 10 * held(2000, 3, 60, 120) + 40
    random = np.random.default_rng(4)
    u, y = np.zeros(2000), np.full(2000, 40.0)
    integral = 0.0
    for t in range(2000):
        if t:
            y[t] = 0.98 * y[t - 1] + 0.02 * (20 + 5 * u[t - 1]) + 0.02 * random.normal()
        integral += 0.02 * (goal[t] - y[t])
        u[t] = 2 * (goal[t] - y[t]) + integral
    path = folder_of(
        tmp_path, text({"t": clock(2000, 1), "sp": goal, "u": u, "y": y}, "t,sp,u,y"), "y"
    )
    assert "# sp looks like the set-point of y, from which u is computed" in path.read_text()
    assert "from_sp" not in path.read_text()
    model = models.load(path)
    first = measurements.validate(model, None).rows[1].value
    trained = measurements.validate(model, trainings.train(model, runs=None).weights).rows[1].value
    assert trained <= first < 0.2 * np.std(y)


@pytest.mark.parametrize("late", ["same", "next"])
@pytest.mark.parametrize("kind", ["proportional", "integrating"])
def test_a_set_point_without_a_telling_name_is_no_input(kind: str, late: str, tmp_path: Path):
    """Of a PI controller that reads the same row, the model had the set-point as an input."""
    files, targets = first_models.RECORDINGS[f"{kind} controller, {late} row"](tmp_path, 0)
    spec = spec_from_data("plant", files, tmp_path, targets).text
    assert "# u2 looks like the set-point of y, from which u1 is computed" in spec
    assert "from_u1" in spec
    assert "from_u2" not in spec


@pytest.mark.parametrize("name", ["sp", "w"])
def test_a_set_point_by_name_needs_an_input_under_feedback(name: str, tmp_path: Path):
    """A controller that runs in every fifth row is not recognised by its output alone."""
    goal = 2 * held(2000, 3, 60, 120)
    random = np.random.default_rng(4)
    u, y, integral = np.zeros(2000), np.zeros(2000), 0.0
    for t in range(1, 2000):
        y[t] = 0.95 * y[t - 1] + 0.05 * u[t - 1] + 0.2 * random.normal()
        integral += 0.05 * (goal[t] - y[t])
        u[t] = u[t - 1] if t % 5 else 2 * (goal[t] - y[t]) + integral
    columns = {"t": clock(2000, 1), name: goal, "u": u, "y": y}
    spec = folder_of(tmp_path, text(columns, f"t,{name},u,y"), "y").read_text()
    assert ("looks like the set-point of y, from which u is computed" in spec) == (name == "sp")


def test_a_first_model_simulates_as_well_as_least_squares_by_numpy():
    (found,) = first_models.compared("short, 120 rows")
    # the written digits change a simulation by 0.1 % at most
    assert found.first == pytest.approx(found.least_squares, rel=1e-3)
    assert found.trained < 0.1 * found.constant
    (_, trained, linear), (rows, new, of_new) = found.pairs
    assert trained <= linear * 1.001
    assert rows == "new recording"
    assert new < 1.1 * of_new


def test_the_weights_are_those_of_least_squares(tmp_path: Path):
    """numpy's solution of the same rows, to the digits that are written."""
    columns = table()
    path = folder_of(tmp_path, text(columns, "t,u,w,y"), "y")
    y, u, w = (np.round(columns[name], 10) for name in ("y", "u", "w"))
    rows = np.arange(3, int(0.8 * ROWS))
    regressors = np.stack([y[rows - 1], u[rows - 3], w[rows - 1], np.ones(len(rows))], axis=1)
    expected = np.linalg.lstsq(regressors, y[rows], rcond=None)[0]
    numbers = re.findall(r"init: \[?(-?[0-9.e-]+)", path.read_text())
    assert sorted(map(float, numbers)) == pytest.approx(sorted(expected.tolist()), rel=2e-3)


def test_a_vibration_gets_a_high_order(tmp_path: Path):
    """Five modes need ten taps; orders ended at four."""
    u = np.random.default_rng(5).normal(size=4000)
    y = np.zeros(4000)
    poles = [0.985 * np.exp(1j * f) for f in (0.3, 0.8, 1.3, 1.9, 2.5)]
    for pole in poles:
        mode = np.zeros(4000)
        for t in range(2, 4000):
            mode[t] = 2 * pole.real * mode[t - 1] - abs(pole) ** 2 * mode[t - 2] + u[t - 1]
        y += mode
    path = folder_of(
        tmp_path, text({"t": clock(4000, 0.001), "u": u, "y": noisy(y, 0.001)}, "t,u,y"), "y"
    )
    window = re.search(r"from_y: \{fir: \{window: (\d+)", path.read_text())
    assert window is not None
    assert int(window[1]) >= 12
    report = measurements.validate(models.load(path), None)
    assert report.rows[1].value < 0.1 * np.std(y)


def test_two_outputs_are_predicted_together(msnn: CommandLine):
    """`--predict` twice: the first one was ignored."""
    u = held(1500, 8)
    x, z = np.zeros(1500), np.zeros(1500)
    for t in range(1, 1500):
        x[t] = 0.9 * x[t - 1] + 0.08 * z[t - 1] + 0.1 * u[t - 1]
        z[t] = 0.85 * z[t - 1] + 0.1 * x[t - 1]
    columns = {"t": clock(1500, 1), "u": u, "T1": noisy(x, 0.001), "T2": noisy(z, 0.001)}
    Path("my.csv").write_text(text(columns, "t,u,T1,T2"))
    said = msnn("init", "plant", "--data", "my.csv", "--predict", "T1", "--predict", "T2")
    assert said.code == 0, said.err
    model = models.load("plant/plant.msnn.yaml")
    assert model.warnings == ()
    assert {output.name for output in model.program.outputs} >= {"T1_next", "T2_next"}
    assert "T1_from_T2" in Path("plant/plant.msnn.yaml").read_text()
    report = measurements.validate(model, None)
    free = [row for row in report.rows if row.horizon == "record"]
    assert len(free) == 2
    assert all(row.value < 0.2 * np.std(columns[row.of[:2]]) for row in free)


def test_several_files_are_recordings_of_one_set(msnn: CommandLine):
    columns = table()
    for number, rows in enumerate((slice(0, 300), slice(300, 600))):
        part = {name: values[rows] for name, values in columns.items()}
        Path(f"run_{number}.csv").write_text(text(part, "t,u,w,y"))
    said = msnn("init", "plant", "--data", "run_*.csv", "--predict", "y")
    assert said.code == 0, said.err
    model = models.load("plant/plant.msnn.yaml")
    data = read_data(model, None, "training")
    assert [record.stop - record.start for record in data.records] == [300, 300]
    again = msnn("init", "other", "--data", "run_0.csv", "--data", "run_1.csv", "--predict", "y")
    assert again.code == 0, again.err


@pytest.mark.parametrize(
    ("header", "step", "reason"),
    [
        ("t,u,y,w2", STEP, "it has no column of numbers `w`"),
        ("t,u,w,y [K]", STEP, "it has no column of numbers `y`"),
        ("t,u,w,y", 1.0, "its rows are 1 s apart, there they are 0.1 s apart"),
        ("t;u;w;y", STEP, "it has another delimiter"),
    ],
)
def test_files_that_are_no_set_are_refused(header: str, step: float, reason: str, tmp_path: Path):
    (tmp_path / "a.csv").write_text(text(table(), "t,u,w,y"))
    delimiter = ";" if ";" in header else ","
    columns = table() | {"t": clock(ROWS, step)}
    (tmp_path / "b.csv").write_text(text(columns, header, delimiter=delimiter))
    with pytest.raises(SpecError, match=f"E0882.*b.csv cannot be in one set with a.csv: {reason}"):
        spec_from_data("plant", [tmp_path / "a.csv", tmp_path / "b.csv"], tmp_path, "y")


def test_a_pattern_without_files_is_told(tmp_path: Path):
    with pytest.raises(SpecError, match=r"E0883.*no file matches"):
        spec_from_data("plant", tmp_path / "*.csv", tmp_path, "y")
