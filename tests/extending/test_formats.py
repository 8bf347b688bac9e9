"""Data files of a plug-in's format are read as ours are, and its mistakes are named as its own."""

from __future__ import annotations

import importlib.metadata
import json
from pathlib import Path

import numpy as np
import pytest

from msnn.api.models import load
from msnn.cli.application import run
from msnn.data.reading.load import load_data
from msnn.features.data_check.first_spec.columns import columns_of
from spec_schema import plugins
from spec_schema.diagnostics.diagnostic import SpecError
from tests.extending.conftest import Install
from tests.extending.test_plugins import RECORD, no_look_up, spec_file

__all__ = ["no_look_up"]

SPEC = (
    "msnn: 1\nname: m\nsample_time: 100 ms\ninputs: {u: {unit: V}}\ntargets: {z: {}}\n"
    "parameters: {k: {init: 1.0, unit: 1/V}}\noutputs: {y: {expr: k * u, predicts: 'z[t]'}}\n"
    "data: {source: {train: LOG}, time: t}\ntrain: [{epochs: 3}]\n"
    "validate: [{of: y, metric: rmse}]\n"
)
ROWS = [{"t": round(0.1 * k, 3), "u": float(k % 7), "z": 2.0 * (k % 7)} for k in range(60)]

READER = """
import os
import numpy as np
from msnn.extending import DataColumns, Feature, FormatLine, LateObject, SpecError

def read(path, shown):
    count = 20
    t = 0.1 * np.arange(count)
    u = z = np.sin(t)
    {body}

FEATURE = Feature(name="logger", formats=(FormatLine(
    name="logger", suffixes=(".lgr",), read=LateObject("logger", "read"), is_isolated={isolated},
),))
"""
WHOLE = "return DataColumns({'t': t, 'u': u, 'z': z}, {'t': 'ms', 'u': 'mV'})"


def json_lines(folder: Path, rows: list[dict[str, object]] | list[str] | None = None) -> Path:
    file = folder / "log.jsonl"
    lines = [row if isinstance(row, str) else json.dumps(row) for row in rows or ROWS]
    file.write_text("".join(f"{line}\n" for line in lines))
    return file


def series(folder: Path, log: str, **replaced: str) -> dict[str, np.ndarray]:
    text = SPEC.replace("LOG", log)
    for old, new in replaced.items():
        text = text.replace(old, new)
    model = load(spec_file(folder, text))
    assert model.spec.data is not None
    return dict(load_data(model.program, model.spec.data, folder).series)


def logger(install: Install, folder: Path, body: str, *, isolated: bool = False) -> None:
    install("logger", {"logger.py": READER.format(body=body, isolated=isolated)}, "logger:FEATURE")
    (folder / "a.lgr").write_bytes(b"\0\1")


@pytest.mark.usefixtures("example")
def test_a_file_of_a_plugin_has_the_values_of_the_same_csv(tmp_path: Path):
    json_lines(tmp_path)
    rows = "".join(f"{row['t']},{row['u']},{row['z']}\n" for row in ROWS)
    (tmp_path / "log.csv").write_text(f"t,u,z\n{rows}")
    found, expected = series(tmp_path, "log.jsonl"), series(tmp_path, "log.csv")
    assert found.keys() == expected.keys() == {"u", "z"}
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)


@pytest.mark.usefixtures("example")
def test_every_command_that_reads_data_reads_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    log = str(json_lines(tmp_path))
    file = str(spec_file(tmp_path, SPEC.replace("LOG", "'*.jsonl'")))
    runs = str(tmp_path / "runs")
    assert run(["check", file]) == 0
    assert run(["data", file]) == 0
    assert "log.jsonl" in capsys.readouterr().out
    assert run(["train", file, "--out", runs]) == 0
    (weights,) = tmp_path.glob("runs/**/weights.safetensors")
    assert run(["validate", file, "--weights", str(weights)]) == 0
    out = str(tmp_path / "simulation.csv")
    assert run(["simulate", file, "--weights", str(weights), "--data", log, "--out", out]) == 0
    monkeypatch.chdir(tmp_path)
    assert run(["init", "new", "--data", "log.jsonl", "--predict", "z"]) == 0
    text = (tmp_path / "new" / "new.msnn.yaml").read_text()
    assert "sample_time: 100 ms" in text
    assert "csv" not in text
    assert run(["train", "new/new.msnn.yaml", "--out", str(tmp_path / "other")]) == 0


@pytest.mark.usefixtures("example")
def test_a_folder_has_files_of_plugins_if_it_has_none_of_ours(tmp_path: Path):
    folder = tmp_path / "logs"
    folder.mkdir()
    json_lines(folder)
    (folder / "notes.md").write_text("a note")
    assert len(series(tmp_path, "logs")["u"]) == len(ROWS)
    (folder / "a.csv").write_text("t,u,z\n0,1,2\n0.1,1,2\n")
    assert len(series(tmp_path, "logs")["u"]) == 2


@pytest.mark.usefixtures("example")
def test_a_null_or_a_missing_key_is_a_missing_value(tmp_path: Path):
    rows: list[dict[str, object]] = [{**row} for row in ROWS]
    rows[3]["z"] = None
    del rows[5]["z"]
    json_lines(tmp_path, rows)
    found = series(tmp_path, "log.jsonl", **{"time: t}": "time: t, nan: split}"})["z"]
    assert list(np.flatnonzero(np.isnan(found))) == [3, 5]


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (['{"t": 0, "u": 1, "z": 2}', "{"], "line 2 of log.jsonl is no JSON: "),
        (['{"t": 0, "u": 1, "z": 2}', "[1, 2]"], "line 2 of log.jsonl is no JSON object"),
        (['{"t": 1' + "0" * 400 + ', "u": 1, "z": 2}'], "`inf` in column `t` is not finite"),
        (["\xff".encode("latin-1").decode("utf-8", "surrogateescape")], "is no JSON"),
        (['{"t": 0, "u": 1}'], "log.jsonl has no column `z`"),
        (['{"t": 0, "u": 1, "z": "on"}'], "it does not hold real numbers"),
        (['{"t": 0, "u": 1, "z": [1]}'], "it does not hold real numbers"),
        (['{"t": 0, "u": 1, "z": Infinity}'], "`inf` in column `z` is not finite"),
        (['{"t": null, "u": 1, "z": 1}'], "`t`"),
        (['{"t": 0, "u": 1, "z": 1}', '{"u": 1, "z": 1}'], "`t`"),
        ([" "], "log.jsonl has no columns `u`, `z`, `t`"),
    ],
)
def test_a_broken_file_is_a_message_of_the_file(
    rows: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    text = "".join(f"{row}\n" for row in rows)
    (tmp_path / "log.jsonl").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(SpecError, match=message) as caught:
        series(tmp_path, "log.jsonl")
    assert all(found.code != "E0230" for found in caught.value.diagnostics)


@pytest.mark.usefixtures("example")
def test_a_message_shows_the_line_of_a_text_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    json_lines(tmp_path, [*map(json.dumps, ROWS), "what"])
    assert run(["data", str(spec_file(tmp_path, SPEC.replace("LOG", "log.jsonl")))]) == 1
    said = capsys.readouterr().err
    assert "log.jsonl:61:1" in said
    assert "61 | what" in said


@pytest.mark.usefixtures("example")
def test_a_file_that_cannot_be_opened_is_no_fault_of_the_plugin(tmp_path: Path):
    (tmp_path / "log.jsonl").symlink_to(tmp_path / "gone")
    with pytest.raises(SpecError, match=r"cannot read log.jsonl: No such file"):
        series(tmp_path, "'*.jsonl'")


@pytest.mark.parametrize("isolated", [False, True])
def test_masked_cells_of_a_plugin_are_missing_values(
    isolated: bool, install: Install, tmp_path: Path
):
    body = (
        "z = np.ma.masked_array((100 * z).astype(int), z > 0.9); "
        "u = np.ma.masked_array(u, np.zeros(count, bool)); "
        f"{WHOLE}"
    )
    logger(install, tmp_path, f"t = 1e3 * t; {body}", isolated=isolated)
    found = series(tmp_path, "a.lgr", **{"time: t}": "time: t, nan: split}"})
    expected = np.sin(0.1 * np.arange(20))
    assert list(np.isnan(found["z"])) == list(expected > 0.9)
    np.testing.assert_allclose(found["u"], 1e-3 * expected)


def test_masked_dates_of_a_plugin_are_missing(install: Install, tmp_path: Path):
    dates = "np.datetime64('2026-01-01') + (1e3 * t).astype('timedelta64[ms]')"
    body = (
        f"t = np.ma.masked_array({dates}, t > 1.85); return DataColumns({{'t': t, 'u': u, 'z': z}})"
    )
    logger(install, tmp_path, body)
    with pytest.raises(SpecError, match="`t`"):
        series(tmp_path, "a.lgr")


@pytest.mark.parametrize("isolated", [False, True])
def test_what_a_reader_prints_is_no_result(
    isolated: bool, install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    logger(install, tmp_path, f"t = 1e3 * t; print('20 rows'); {WHOLE}", isolated=isolated)
    file = str(spec_file(tmp_path, SPEC.replace("LOG", "a.lgr")))
    out = str(tmp_path / "y.csv")
    assert run(["simulate", file, "--initial", "--out", out, "--format", "json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["command"] == "simulate"
    assert ("20 rows" in said.err) != isolated


@pytest.mark.parametrize("isolated", [False, True])
def test_verbose_shows_the_traceback_of_a_reader(
    isolated: bool, install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    logger(install, tmp_path, "raise KeyError('channel')", isolated=isolated)
    file = str(spec_file(tmp_path, SPEC.replace("LOG", "a.lgr")))
    for _ in range(2):
        assert run(["data", file, "--verbose"]) == 1
        said = capsys.readouterr().err
        assert said.count("Traceback") == 1
        assert "line 10, in read" in said
    assert run(["data", file]) == 1
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("isolated", [False, True])
def test_units_of_a_plugin_are_converted(isolated: bool, install: Install, tmp_path: Path):
    logger(install, tmp_path, f"t = 1e3 * t; {WHOLE}", isolated=isolated)
    found = series(tmp_path, "a.lgr")
    np.testing.assert_allclose(found["u"], 1e-3 * found["z"], rtol=1e-15)
    table = columns_of(tmp_path / "a.lgr")
    assert [column.name for column in table.columns] == ["t_", "u", "z"]
    assert [str(c.unit and c.unit.text) for c in table.columns] == ["ms", "mV", "None"]


def test_dates_of_a_plugin_are_times(install: Install, tmp_path: Path):
    dates = "np.datetime64('2026-01-01') + (1e3 * t).astype('timedelta64[ms]')"
    logger(install, tmp_path, f"return DataColumns({{'t': {dates}, 'u': u, 'z': z}})")
    assert len(series(tmp_path, "a.lgr")["u"]) == 20
    dated = columns_of(tmp_path / "a.lgr").dates
    assert dated is not None
    np.testing.assert_allclose(dated.values, 0.1 * np.arange(20), atol=1e-12)


FAULTS = {
    "raise KeyError('channel')": "raised KeyError: 'channel' (logger, line 10, in read)",
    "raise SystemExit(3)": "raised SystemExit: 3",
    "open('/not/there')": "raised FileNotFoundError",
    "raise SpecError([])": "raised a SpecError without an error: write `SpecError([error(...)])`",
    "return DataColumns({'t': np.ma.masked_array(list('ab'), [0, 1])})": "no missing value",
    "return None": "returned a NoneType, not `msnn.extending.DataColumns`",
    "return {'t': t, 'u': u, 'z': z}": "returned a dict, not `msnn.extending.DataColumns`",
    "return DataColumns([t, u, z])": "returned columns or units that are no mapping",
    "return DataColumns({'t': t, 1: u})": "returned columns or units that are no mapping",
    "return DataColumns({'t': t}, {'t': 3})": "returned columns or units that are no mapping",
    "return DataColumns({'t': t, 'u': u, 'z': z[1:]})": "unequal lengths: `t` has 20 rows, `u` has",
    "return DataColumns({'t': t, 'u': u, 'z': 3.0})": "`z` has one value",
    "return DataColumns({'t': [[1], [1, 2]]})": "returned a column that is no array",
}


@pytest.mark.parametrize(
    ("body", "isolated"),
    [*((body, False) for body in FAULTS), *((body, True) for body in list(FAULTS)[:5])],
)
def test_a_fault_of_a_reader_names_the_plugin(
    body: str, isolated: bool, install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    logger(install, tmp_path, body, isolated=isolated)
    assert run(["data", str(spec_file(tmp_path, SPEC.replace("LOG", "a.lgr")))]) == 1
    said = capsys.readouterr().err
    reader = "cannot read a.lgr: the reader of logger files of the package logger 0.1.0"
    assert f"error[E0230]: {reader} " in said
    assert FAULTS[body] in said
    assert "Traceback" not in said


def test_a_reader_that_crashes_its_process_is_named(install: Install, tmp_path: Path):
    logger(install, tmp_path, "os.abort()", isolated=True)
    with pytest.raises(SpecError, match=r"of the package logger 0\.1\.0 ended its process"):
        series(tmp_path, "a.lgr")


@pytest.mark.usefixtures("no_look_up")
def test_a_suffix_of_ours_is_not_looked_up(tmp_path: Path):
    (tmp_path / "log.csv").write_text("t,u,z\n0,1,2\n0.1,1,2\n")
    for log in ("log.csv", "."):
        assert len(series(tmp_path, log)["u"]) == 2


@pytest.mark.usefixtures("no_look_up")
def test_a_suffix_that_is_not_ours_is_looked_up(tmp_path: Path):
    json_lines(tmp_path)
    with pytest.raises(AssertionError, match="looked up"):
        series(tmp_path, "log.jsonl")


NO_SUFFIX = "it is no suffix, which is a dot with lower-case letters and digits"


@pytest.mark.parametrize(
    ("suffix", "reason"),
    [
        (".csv", "msnn reads files of this suffix"),
        (".jsonl", "the package msnn-example has this format already"),
        *((suffix, NO_SUFFIX) for suffix in ("lgr", ".LGR", ".a.b", ".", "")),
    ],
)
def test_a_suffix_that_is_taken_or_no_suffix_is_left_out(
    suffix: str, reason: str, example: None, install: Install, tmp_path: Path
):
    text = READER.format(body="", isolated=False).replace('".lgr"', f'"{suffix}", ".fine"')
    install("other", {"logger.py": text}, "logger:FEATURE")
    (warning,) = plugins.look_up().warnings
    assert warning.code == "W0222"
    assert warning.message == (f"the format `{suffix}` of the package other is left out: {reason}")
    brought = {each.package: each.keys for each in plugins.known_plugins()}
    assert brought["other"] == {("format", ".fine")}
    assert ("format", ".jsonl") in brought["msnn-example"]


@pytest.mark.parametrize("verb", ["check", "data"])
def test_a_plugin_that_is_left_out_is_reported_where_its_files_are_read(
    verb: str, install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    install("broken", {"broken.py": "raise RuntimeError('no licence')"}, "broken:FEATURE")
    (tmp_path / "a.lgr").write_text("t,u,z\n0,1,2\n0.1,1,2\n")
    run([verb, str(spec_file(tmp_path, SPEC.replace("LOG", "a.lgr")))])
    assert capsys.readouterr().err.count("RuntimeError: no licence") == 1


def test_a_line_of_another_kind_is_refused(install: Install):
    text = RECORD.format(key="fine", module="broken").replace("sections=", "formats=")
    install("broken", {"broken.py": text}, "broken:FEATURE")
    (warning,) = plugins.look_up().warnings
    assert "`formats` of its record is no tuple of FormatLine" in warning.message


def test_without_the_plugin_its_files_are_read_as_text(
    example: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    json_lines(tmp_path)
    series(tmp_path, "log.jsonl")
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda **wanted: ())
    plugins.forget()
    with pytest.raises(SpecError, match="E0932"):
        series(tmp_path, "log.jsonl")


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            "return DataColumns({'t': t, 'u': u, 'z': z}, {'U': 'mV'})",
            "E0230|logger files|returned a unit for `U`, which is none of its columns",
        ),
        (
            "return DataColumns({'t': t, 'u': u, 'z': np.arange(20).astype('datetime64[s]')})",
            "E0840|`z` of a.lgr cannot feed|returns dates (datetime64), not numbers",
        ),
        (
            "return DataColumns({'t': t, 'u': np.arange(20).astype('timedelta64[s]'), 'z': z})",
            "E0840|`u` of a.lgr cannot feed|returns durations (timedelta64), not numbers",
        ),
    ],
)
def test_units_and_dates_of_the_wrong_columns_are_named(
    body: str,
    message: str,
    isolated: bool,
    install: Install,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    logger(install, tmp_path, body, isolated=isolated)
    assert run(["data", str(spec_file(tmp_path, SPEC.replace("LOG", "a.lgr")))]) == 1
    said = capsys.readouterr().err
    assert all(part in said for part in (*message.split("|"), "of the package logger 0.1.0"))
