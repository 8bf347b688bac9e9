"""A text target of a plug-in is written where it is named, and is not compared."""

from __future__ import annotations

import importlib.metadata
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from backends.files.export_identity import read_manifest
from msnn.agreement.agreement import Agreement, FarStep
from msnn.api.models import load
from msnn.cli.application import run
from msnn.exports import check
from msnn.exports.export import target_names
from msnn.exports.table import NAMES
from msnn.exports.target import AnyPlan
from msnn.features.changes.interface_changes import export_changes
from msnn.reports.compare_specs import compare_specs
from spec_schema import plugins
from tests.extending.conftest import Install
from tests.extending.test_plugins import BUDGET, PLAIN, TARGET, spec_file

SHEET = f"{PLAIN}export: {{datasheet: {{}}}}\n"
WITH = "# made by msnn 0.1.0 with msnn-example 0.1.0"


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize(("text", "to"), [(SHEET, []), (PLAIN, ["--to", "datasheet"])])
def test_a_target_of_a_plugin_is_written_where_it_is_named(
    text: str, to: list[str], tmp_path: Path
):
    file, out = spec_file(tmp_path, text), tmp_path / "out"
    for _ in range(2):  # files of its own are replaced
        assert run(["export", str(file), "--initial", "--out", str(out), *to]) == 0
    folder = out / "datasheet"
    assert {path.name for path in folder.iterdir()} == {"plain.md", "manifest.sha256"}
    assert "| k | 2.0 |" in (folder / "plain.md").read_text()
    # the data sheet of a spec that names the plug-in says so itself; the manifest always does
    assert (folder / "manifest.sha256").read_text().startswith(WITH)
    assert read_manifest(folder).keys() == {"plain.md"}


@pytest.mark.usefixtures("example")
def test_all_targets_are_ours(tmp_path: Path):
    plugins.look_up()
    assert set(target_names(["all"], None, sections=["mpc"])) == set(NAMES)
    assert "datasheet" in target_names(["c", "datasheet"], None)
    assert target_names(["all", "datasheet"], None, sections=["mpc"]) == (*NAMES, "datasheet")


@pytest.mark.usefixtures("example")
def test_all_targets_are_those_that_the_spec_names_too(tmp_path: Path):
    export = load(spec_file(tmp_path, SHEET)).spec.export
    assert target_names(["all"], export, sections=["mpc"]) == (*NAMES, "datasheet")


@pytest.mark.usefixtures("example")
def test_a_target_that_nothing_runs_is_not_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    file = spec_file(tmp_path, SHEET)
    out = str(tmp_path / "out")
    arguments = ["export", str(file), "--initial", "--check", "--out", out, "--to"]
    assert run([*arguments, "datasheet,c"]) == 5
    said = capsys.readouterr()
    assert re.search("datasheet  float64 +not compared", said.out)
    assert "E1133" in said.err
    assert re.search("c +float32 .* agrees", said.out)


@pytest.mark.usefixtures("install")
def test_a_target_of_no_plugin_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run(["export", str(spec_file(tmp_path, PLAIN)), "--to", "datasheet"]) == 2
    assert "`datasheet` is none of torch" in capsys.readouterr().err
    assert run(["check", str(spec_file(tmp_path, SHEET))]) == 1
    assert "unknown key `datasheet` in export" in capsys.readouterr().err


def test_a_broken_plugin_is_named_where_its_target_is_asked_for(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    install("broken", {"broken.py": "raise ValueError('no')"}, "broken:FEATURE")
    assert run(["export", str(spec_file(tmp_path, PLAIN)), "--to", "datasheet"]) == 2
    assert "of the package broken is left out: ValueError: no" in capsys.readouterr().err


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize(
    ("target", "file"),
    [
        ("c", "plain.json"),
        ("c", "include/plain.h"),
        ("casadi", "plain.json"),
        ("onnx", "plain.onnx"),
        ("torch", "plain.py"),
    ],
)
def test_exports_of_a_spec_name_its_plugins(target: str, file: str, tmp_path: Path):
    pytest.importorskip({"c": "numpy"}.get(target, target))
    spec = spec_file(tmp_path, BUDGET)
    out = tmp_path / "out"
    assert run(["export", str(spec), "--initial", "--to", target, "--out", str(out)]) == 0
    assert b"with msnn-example 0.1.0" in (out / target / file).read_bytes()


@pytest.mark.usefixtures("example")
def test_changes_of_a_target_of_a_plugin_are_seen(tmp_path: Path):
    old = load(spec_file(tmp_path, SHEET))
    new = load(
        spec_file(tmp_path, SHEET.replace("{datasheet: {}}", "{datasheet: {dtype: float32}}"))
    )
    (change,) = export_changes(old, new)
    assert (change.part, change.what) == ("export datasheet", "dtype")
    # a target that is added changes the workflow and not the model
    assert compare_specs(load(spec_file(tmp_path, PLAIN)), old).kind == "workflow"


@pytest.mark.usefixtures("example")
def test_a_spec_read_before_the_look_up_is_exported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    entry_points = importlib.metadata.entry_points
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda **wanted: ())
    model = load(spec_file(tmp_path, f"{PLAIN}export: {{c: {{}}}}\n"))
    monkeypatch.setattr(importlib.metadata, "entry_points", entry_points)
    plugins.forget()
    plugins.look_up()
    assert target_names([], model.spec.export) == ("c",)
    assert not list(model.spec.sections())


@pytest.mark.usefixtures("example")
def test_the_help_lists_it_with_its_package(capsys: pytest.CaptureFixture[str]):
    assert run(["export", "--help"]) == 0
    _, _, listed = capsys.readouterr().out.partition("\nTargets of plug-ins:\n")
    assert listed == "  datasheet  a data sheet in Markdown (msnn-example 0.1.0)\n"


def test_the_help_leaves_out_what_is_taken(install: Install, capsys: pytest.CaptureFixture[str]):
    install("stranger", {"stranger.py": TARGET.format(key="onnx", name="onnx")}, "stranger:FEATURE")
    assert run(["export", "--help"]) == 0
    said = capsys.readouterr()
    assert "plug-ins" not in said.out
    assert "the target `onnx` of the package stranger is left out" in said.err


WRITES = """
from msnn.extending import *

class Sheet(FloatTargetEntry):
    pass

def prepare(request, entry):
    return float_plan(SHEET, request, entry)

def write(plan, weights, folder):
    try:
        weights["k"][...] = 7
    except ValueError:
        pass
    try:
        weights["k"].setflags(write=True)
    except ValueError:
        pass
    (folder / "a.txt").write_text("a")
    return (folder / "a.txt",)

SHEET = Target(name="sheet", entry=Sheet, dtype="float64", options=None,
               prepare=prepare, write=write)
FEATURE = Feature(name="writes", targets=(
    TargetLine("sheet", LateEntry("writes", "Sheet"), LateObject("writes", "SHEET"), "", "", ""),
))
"""


def test_later_targets_get_the_same_weights(install: Install, tmp_path: Path):
    install("writes", {"writes.py": WRITES}, "writes:FEATURE")
    file = str(spec_file(tmp_path, PLAIN))
    for name, to in (("alone", "casadi"), ("after", "sheet,casadi")):
        out = str(tmp_path / name)
        assert run(["export", file, "--initial", "--to", to, "--out", out]) == 0
    alone, after = (
        (tmp_path / name / "casadi" / "plain.json").read_text() for name in ("alone", "after")
    )
    assert alone == after


@pytest.mark.usefixtures("example")
def test_an_export_that_differs_outweighs_one_that_is_not_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    of_target = check.check_export

    def differs(plan: AnyPlan, *arguments: Any) -> Agreement:
        found = of_target(plan, *arguments)
        return replace(found, faults=(FarStep("y", 0.5, 1e-9),))

    monkeypatch.setattr(check, "check_export", differs)
    words = ["export", str(spec_file(tmp_path, SHEET)), "--initial", "--check"]
    assert run([*words, "--out", str(tmp_path / "out"), "--to", "casadi,datasheet"]) == 3
    said = capsys.readouterr()
    assert re.search("casadi +float64 .* DIFFERS", said.out)
    assert "E1133" in said.err
    assert "E1057" in said.err
