"""`msnn diff`: what it says of equal, rewritten, renamed, retrained and other models."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC, change

NEW = "new.yaml"


@pytest.fixture
def copy(project: Path) -> Path:
    (project / NEW).write_text((project / SPEC).read_text())
    return project


def _change(folder: Path, old: str, new: str) -> None:
    text = (folder / NEW).read_text()
    assert old in text
    (folder / NEW).write_text(text.replace(old, new, 1))


def test_a_copy_is_the_same(msnn: CommandLine, copy: Path):
    said = msnn("diff", SPEC, NEW)
    assert (said.code, said.out, said.err) == (0, "the same\n", "")


def test_comments_layout_and_shorthands_are_only_text(msnn: CommandLine, copy: Path):
    _change(copy, "integrator: rk4", "# a comment\n\nintegrator: {rk4: {substeps: 1}}")
    _change(copy, "(F - c*v - k*x) / m", "(F - c * v - k * x) / m")
    said = msnn("diff", SPEC, NEW)
    assert said.code == 0
    assert said.out == "the same model: only its text differs, such as comments or layout\n"


def test_another_doc_is_shown_and_still_the_same(msnn: CommandLine, copy: Path):
    _change(copy, "doc: stiffness", "doc: spring")
    said = msnn("diff", SPEC, NEW)
    assert said.code == 0
    assert said.out.startswith("parameters.k.doc\n  - stiffness\n  + spring\n\nthe same model")


def test_an_equation_a_bound_and_an_input(msnn: CommandLine, copy: Path):
    _change(copy, "(F - c*v - k*x) / m", "(F - c*v - k*x**3) / m")
    _change(copy, "{init: 2, unit: N*s/m", "{init: 2, min: 0, unit: N*s/m")
    said = msnn("diff", SPEC, NEW)
    assert said.code == 1
    assert said.out == (
        "parameters.c.min\n  + 0\n"
        "equations.a.expr\n  - (F - c * v - k * x) / m\n  + (F - c * v - k * x**3) / m\n"
        "\ninterface           new      breaks, since\n"
        "parameter c  range  0 … inf  values that were allowed are not\n"
        "\nthe models differ; 1 change of the interface breaks those who use it\n"
    )


def test_renaming_says_so(msnn: CommandLine, copy: Path):
    text = (copy / NEW).read_text()
    (copy / NEW).write_text(re.sub(r"\bk\b", "stiffness", text))
    _change(copy, "doc: stiffness", "doc: stiffness")
    said = msnn("diff", SPEC, NEW)
    assert said.code == 1
    assert said.out.startswith("k → stiffness\n\ninterface ")
    assert said.out.endswith(
        "\n\nonly renamed: all formulas and settings are the same; "
        "1 change of the interface breaks those who use it\n"
    )


def test_a_renaming_beside_another_change_is_no_renaming(msnn: CommandLine, copy: Path):
    text = (copy / NEW).read_text()
    (copy / NEW).write_text(re.sub(r"\bk\b", "stiffness", text))
    _change(copy, "init: 10,", "init: 11,")
    assert "\nthe models differ;" in msnn("diff", SPEC, NEW).out


def test_only_the_workflow(msnn: CommandLine, copy: Path):
    _change(copy, "epochs: 80", "epochs: 90")
    said = msnn("diff", SPEC, NEW)
    assert said.code == 1
    assert said.out.startswith("train.0.epochs\n  - 80\n  + 90\n")
    assert "its workflow differs in `train`" in said.out


def test_json_and_program_files(msnn: CommandLine, copy: Path):
    change(copy, "epochs: 80", "epochs: 81")
    assert msnn("compile", SPEC).code == 0
    said = msnn("diff", "--format", "json", "build/plant.program.json", NEW)
    assert said.code == 1
    record = json.loads(said.out)
    assert (record["version"], record["same"], record["kind"]) == (1, False, "workflow")
    assert record["changes"] == [{"path": "train.0.epochs", "old": 81, "new": 80}]


def test_a_broken_spec_is_said(msnn: CommandLine, copy: Path):
    _change(copy, "k*x", "kk*x")
    said = msnn("diff", SPEC, NEW)
    assert (said.code, said.out) == (1, "")
    assert "error[E0301]" in said.err


def test_a_setting_is_one_of_both_models(msnn: CommandLine, copy: Path):
    _change(copy, "epochs: 80", "epochs: 90")
    assert msnn("diff", SPEC, NEW).code == 1
    said = msnn("diff", SPEC, NEW, "--set", "train.0.epochs=7")
    assert (said.code, said.out) == (
        0,
        "the same model: only its text differs, such as comments or layout\n",
    )


@pytest.mark.parametrize(("side", "signs"), [("--set-new", ("-", "+")), ("--set-old", ("+", "-"))])
def test_a_setting_of_one_model_shows_what_it_changes(
    msnn: CommandLine, project: Path, side: str, signs: tuple[str, str]
):
    said = msnn("diff", SPEC, SPEC, side, "train.0.epochs=7")
    assert said.code == 1
    lines = said.out.splitlines()
    assert lines[0] == "train.0.epochs"
    assert lines[1 if signs[1] == "-" else 2] == f"  {signs[1]} 7"
    assert "its workflow differs in `train`" in lines[-1]


def test_what_only_a_setting_changes_is_not_the_same(msnn: CommandLine, project: Path):
    """The text of both files is one and the same."""
    said = msnn("diff", SPEC, SPEC, "--set-new", "parameters.k.init=31")
    assert said.code == 1
    assert "the models differ" in said.out


def test_a_setting_that_does_not_fit_is_said(msnn: CommandLine, project: Path):
    said = msnn("diff", SPEC, SPEC, "--set-old", "parameters.nothing.init=31")
    assert said.code == 1
    assert "error[" in said.err
