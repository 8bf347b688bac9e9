"""Runs name the plug-ins that read their data; commands compare them with those installed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from msnn.cli.application import run
from spec_schema import plugins
from tests.conditions import require_tool
from tests.extending.conftest import Install
from tests.extending.test_formats import READER, SPEC
from tests.extending.test_plugins import spec_file

OLD = "return DataColumns({'t': t, 'u': u, 'z': 2 * z})"
NEW = "return DataColumns({'t': t, 'u': u, 'z': 4 * z})"
AS_TEXT = "t,u,z\n" + "".join(f"{k / 10},{k % 7},{k % 5}\n" for k in range(20))
"""A file of `logger` that is also CSV, with other values."""


def put(install: Install, body: str, version: str, suffix: str = ".lgr") -> None:
    text = READER.format(body=body, isolated=False).replace(".lgr", suffix)
    install("logger", {"logger.py": text}, "logger:FEATURE", version)


@pytest.fixture
def trained(install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run whose data version 1.0 of a plug-in has read."""
    require_tool("gcc", install="apt install gcc")
    monkeypatch.chdir(tmp_path)
    put(install, OLD, "1.0")
    (tmp_path / "a.lgr").write_text(AS_TEXT)
    text = SPEC.replace("LOG}", "a.lgr}, split: {by: fraction, train: 0.5, val: 0.5}")
    assert run(["train", str(spec_file(tmp_path, text)), "-q"]) == 0
    (record,) = tmp_path.glob("runs/m/2*/run.json")
    return record.parent


def test_a_run_names_the_plugin_of_its_data(trained: Path, capsys: pytest.CaptureFixture[str]):
    record = json.loads((trained / "run.json").read_text())
    assert record["data"]["plugins"] == {".lgr": {"package": "logger", "version": "1.0"}}
    # the model needs no plug-in
    assert "plugins" not in record
    capsys.readouterr()
    assert run(["show", str(trained)]) == 0
    assert "data read by  logger 1.0\n" in capsys.readouterr().out
    assert run(["report", str(trained), "--out", "page.html"]) == 0
    assert "logger 1.0" in Path("page.html").read_text(encoding="utf-8")
    assert run(["diff", str(trained), "m.msnn.yaml"]) == 0
    assert "logger" not in capsys.readouterr().out


READS_DATA = [
    ["train", "RUN"],
    ["validate", "RUN"],
    ["simulate", "RUN"],
    ["simulate", "RUN", "--data", "a.lgr"],
    ["compare", "RUN"],
    ["data", "RUN"],
    ["sweep", "RUN", "--grid", "train.0.epochs=1,2"],
    ["report", "RUN"],
    ["diff", "RUN", "RUN"],
]


@pytest.mark.parametrize("words", READS_DATA, ids=" ".join)
def test_data_of_a_run_are_not_read_without_the_plugin(
    words: list[str], trained: Path, remove: Callable[[], None], capsys: pytest.CaptureFixture[str]
):
    remove()
    capsys.readouterr()
    # `compare` and `sweep` go on with other trainings
    code = 1 if words[0] in ("compare", "sweep") else 5
    assert run([str(trained) if word == "RUN" else word for word in words]) == code
    said = capsys.readouterr().err
    assert re.search(
        r"error\[E1037\]: the plug-in logger 1\.0, which \S*a\.lgr needs, is not installed", said
    )
    assert "help: pip install logger" in said
    assert "W0957" not in said


def test_commands_that_read_no_data_work_without_the_plugin(
    trained: Path, remove: Callable[[], None], capsys: pytest.CaptureFixture[str]
):
    remove()
    capsys.readouterr()
    assert run(["show", str(trained)]) == 0
    missing = "data read by  logger 1.0 (not installed: pip install logger)\n"
    assert missing in capsys.readouterr().out
    assert run(["export", str(trained), "--to", "c", "--out", "out"]) == 0
    assert Path("out", "c", "manifest.sha256").is_file()
    assert run(["diff", str(trained), "m.msnn.yaml"]) == 0
    assert "plug-in  old\nlogger   1.0\n" in capsys.readouterr().out


@pytest.mark.parametrize("words", READS_DATA[:6], ids=" ".join)
def test_another_version_that_reads_the_data_is_warned_of(
    words: list[str], trained: Path, install: Install, capsys: pytest.CaptureFixture[str]
):
    put(install, NEW, "2.0")
    capsys.readouterr()
    run([str(trained) if word == "RUN" else word for word in words])
    captured = capsys.readouterr()
    said = captured.out + captured.err
    assert "the `.lgr` files of the run were read with logger 1.0, and 2.0 is installed" in said
    if words[0] != "compare":
        assert "warning[W0956]" in said


def test_diff_names_both_versions_of_data_plugins(
    trained: Path, install: Install, capsys: pytest.CaptureFixture[str]
):
    put(install, NEW, "2.0")
    capsys.readouterr()
    assert run(["diff", str(trained), "m.msnn.yaml"]) == 0
    assert "plug-in  old  new\nlogger   1.0  2.0\n" in capsys.readouterr().out
    assert run(["show", str(trained)]) == 0
    assert "data read by  logger 1.0 (2.0 is installed)\n" in capsys.readouterr().out


def test_a_version_that_reads_other_files_is_refused(
    trained: Path, install: Install, capsys: pytest.CaptureFixture[str]
):
    put(install, NEW, "2.0", suffix=".lg2")
    assert run(["validate", str(trained)]) == 5
    said = capsys.readouterr().err
    assert "does not work: the installed version 2.0 does not read `.lgr` files" in said


def test_a_plugin_that_came_after_the_run_is_warned_of(
    trained: Path, install: Install, capsys: pytest.CaptureFixture[str]
):
    file = trained / "run.json"
    record = json.loads(file.read_text())
    del record["data"]["plugins"]
    file.write_text(json.dumps(record))
    put(install, NEW, "2.0")
    run(["validate", str(trained)])
    said = capsys.readouterr().err
    assert "warning[W0956]: the `.lgr` files of the run were read without a plug-in" in said


def test_other_data_of_a_run_are_not_compared(
    trained: Path, remove: Callable[[], None], capsys: pytest.CaptureFixture[str]
):
    remove()
    Path("b.csv").write_text(AS_TEXT)
    capsys.readouterr()
    assert run(["simulate", str(trained), "--data", "b.csv", "--out", "simulated.csv"]) == 0
    assert capsys.readouterr().err.count("logger") == 0


@pytest.mark.parametrize(
    "damaged",
    [3, [], {".lgr": 1}, {".lgr": {"package": "logger"}}, {"": {"package": "", "version": ""}}],
    ids=str,
)
def test_a_damaged_record_of_data_is_read(
    damaged: object, trained: Path, capsys: pytest.CaptureFixture[str]
):
    file = trained / "run.json"
    record = json.loads(file.read_text())
    record["data"]["plugins"] = damaged
    file.write_text(json.dumps(record))
    assert run(["show", str(trained)]) == 0
    assert run(["validate", str(trained)]) == 0
    assert "Traceback" not in capsys.readouterr().err


# files of no format


def test_a_file_of_no_format_is_read_as_text_with_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "a.imc").write_text(AS_TEXT)
    spec = str(spec_file(tmp_path, SPEC.replace("LOG", "'*.imc'")))
    (tmp_path / "b.imc").write_text(AS_TEXT)
    assert run(["data", spec]) == 0
    said = capsys.readouterr().err
    reads = (
        "warning[W0957]: no format of msnn and no installed plug-in reads `.imc` files: they are"
    )
    assert said.count(reads) == 1


@pytest.mark.parametrize("name", ["a.log", "a.dat", "a.asc", "a.txt", "a.PRN", "a.csv", "a"])
def test_usual_names_of_text_files_are_read_silently(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / name).write_text(AS_TEXT)
    assert run(["data", str(spec_file(tmp_path, SPEC.replace("LOG", name)))]) == 0
    assert "W0957" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "fault", "repair"),
    [
        (b"|CF,2,1,1;|CK,1,3,1,1;\n1;2;3\n4;5;6\n", "has no columns", ""),
        (b"imc log\nversion 2\nt,u,z\n0,1,2\n0.1,1,2\n", "is its line 3", "{skip: 2}"),
        ("t,u,z\n0,1,2°\n".encode("latin-1"), "it is not UTF-8 text", "iconv"),
        (b"PK\x03\x04" + b"\x00" * 40, "", ""),
        (b"", "is empty", "or save the file as CSV"),
        (b"t,u,z\n0,1,2\n0.1,one,2\n", "`one`", ""),
    ],
)
@pytest.mark.parametrize("verb", ["data", "train"])
def test_a_file_that_only_a_plugin_reads_says_so(
    verb: str,
    content: bytes,
    fault: str,
    repair: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.imc").write_bytes(content)
    spec = str(spec_file(tmp_path, SPEC.replace("LOG", "log.imc")))
    assert run([verb, spec]) == 1
    said = capsys.readouterr().err
    assert "error[E0932]: no format of msnn and no installed plug-in reads `.imc` files; " in said
    assert "help: install the plug-in that reads `.imc` files (`msnn doctor` lists" in said
    assert "W0957" not in said
    assert fault in said
    assert repair in said


@pytest.mark.parametrize("content", [b"\x00\xff\xfe\x80" * 40, b"imc log\nversion 2\n"])
def test_a_new_spec_of_a_file_of_no_format_says_so(
    content: bytes,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.imc").write_bytes(content)
    assert run(["init", "new", "--data", "log.imc", "--predict", "z"]) == 1
    assert "error[E0932]: no format of msnn and no installed" in capsys.readouterr().err


def test_a_new_spec_notes_that_its_file_was_taken_as_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{k / 10},{k % 7},{k % 5}\n" for k in range(60))
    (tmp_path / "log.imc").write_text(f"t,u,z\n{rows}")
    assert run(["init", "new", "--data", "log.imc", "--predict", "z"]) == 0
    note = "note: no format of msnn and no installed plug-in reads `.imc` files: they are read as"
    assert note in capsys.readouterr().err
    assert "no installed plug-in reads" in (tmp_path / "new" / "new.msnn.yaml").read_text()


def test_a_file_of_a_known_format_keeps_its_repair(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "log.gz").write_bytes(b"\x1f\x8b" + bytes(20))
    assert run(["data", str(spec_file(tmp_path, SPEC.replace("LOG", "log.gz")))]) == 1
    said = capsys.readouterr().err
    assert "help: unpack it: `gzip -dc log.gz > unpacked.csv`" in said
    assert "E0932" not in said


def test_a_file_that_cannot_be_opened_may_have_any_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "log.imc").symlink_to(tmp_path / "gone")
    assert run(["data", str(spec_file(tmp_path, SPEC.replace("LOG", "'*.imc'")))]) == 1
    said = capsys.readouterr().err
    assert "E0802" in said
    assert "E0932" not in said


# two packages


def test_a_run_names_the_package_that_reads_its_suffix_now(
    trained: Path, install: Install, capsys: pytest.CaptureFixture[str]
):
    other = READER.format(body=NEW, isolated=False).replace('"logger"', '"alog"')
    install("alog", {"alog.py": other}, "alog:FEATURE", "3.0")
    capsys.readouterr()
    assert run(["validate", str(trained)]) == 5
    said = capsys.readouterr().err
    assert "does not work: the package alog 3.0 reads `.lgr` files now" in said
    assert "help: remove alog, or train again with it" in said


@pytest.mark.parametrize("verb", ["check", "data", "train"])
def test_commands_name_two_packages_of_one_suffix(
    verb: str, install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    put(install, OLD, "1.0")
    other = READER.format(body=NEW, isolated=False).replace('"logger"', '"other"')
    other = other.replace('".lgr"', '".lgr", ".csv", ".lg2"')
    install("other", {"other.py": other}, "other:FEATURE")
    (tmp_path / "a.lgr").write_text("")
    spec = str(spec_file(tmp_path, SPEC.replace("LOG", "a.lgr")))
    words = ["--out", str(tmp_path / "runs")] if verb == "train" else []
    assert run([verb, spec, *words]) == 0
    said = capsys.readouterr().err
    left_out = "the format `.lgr` of the package other is left out: the package logger has this"
    assert said.count(f"warning[W0222]: {left_out}") == 1
    # a name that this file has nothing to do with
    assert "`.csv`" not in said


def test_packages_without_metadata_are_plugins(
    install: Install, site: Path, capsys: pytest.CaptureFixture[str]
):
    for name, suffix in (("logger", ".lgr"), ("other", ".oth")):
        text = READER.format(body=OLD, isolated=False).replace(".lgr", suffix)
        text = text.replace('"logger"', f'"{name}"')
        install(name, {f"{name}.py": text}, f"{name}:FEATURE")
    for metadata in site.glob("*.dist-info/METADATA"):
        metadata.unlink()
    plugins.forget()
    assert run(["doctor"]) in (0, 5)
    said = capsys.readouterr()
    assert re.search(r"logger +of unknown version +plug-in: format \.lgr\n", said.out)
    assert re.search(r"other +of unknown version +plug-in: format \.oth\n", said.out)
    assert "None" not in said.out + said.err
    assert run(["doctor", "--format", "json"]) in (0, 5)
    found = json.loads(capsys.readouterr().out)["plugins"]
    assert [each["package"] for each in found] == ["logger", "other"]
