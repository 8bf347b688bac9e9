"""`msnn check`: what it prints where, in which format, and with which exit code."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.command_line import CommandLine

SPEC = "plant.msnn.yaml"
SUMMARY = "plant: 1 input, 1 output, 2 states, 3 parameters, a sample every 0.05 s\n"


def change(folder: Path, old: str, new: str) -> None:
    path = folder / SPEC
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_a_good_spec_gets_one_line_on_stdout(msnn: CommandLine, project: Path):
    said = msnn("check", SPEC)
    assert (said.code, said.out, said.err) == (0, SUMMARY, "")


def test_a_blank_line_parts_warnings_from_what_follows(msnn: CommandLine, project: Path):
    change(project, "  k: {init: 10", "  spare: 1\n  k: {init: 10")
    said = msnn("validate", SPEC)
    assert said.code == 1
    warning, error = said.err.rstrip().split("\n\n")
    assert warning.startswith("warning[W0301]: ")
    assert error.startswith("error[E1036]: ")


def test_a_remark_is_a_note_of_check_alone(msnn: CommandLine, project: Path):
    """Whether a force is held between samples only its author knows."""
    change(project, "between: hold, ", "")
    said = msnn("check", SPEC)
    assert (said.code, said.out) == (0, SUMMARY)
    assert said.err.startswith("note[W0748]: `F` is held between samples while `m`, `c`, `k` are")
    assert msnn("check", "--format", "github", SPEC).err.startswith("::notice title=W0748,")
    assert msnn("show", SPEC).err == ""


def test_a_broken_spec_is_explained_on_stderr(msnn: CommandLine, project: Path):
    change(project, "k*x", "kk*x")
    said = msnn("check", SPEC)
    assert said.code == 1
    assert said.out == ""
    assert said.err == (
        "error[E0301]: unknown name `kk`\n"
        "  --> plant.msnn.yaml:23:17\n"
        "   |\n"
        "23 |   a: (F - c*v - kk*x) / m          # Newton's law; a bare name is its value at t\n"
        "   |                 ^^ not an input, parameter, layer or equation\n"
        "   = help: did you mean `k`?\n"
    )


def test_concise_and_github_diagnostics(msnn: CommandLine, project: Path):
    change(project, "k*x", "kk*x")
    concise = msnn("check", "--format", "concise", SPEC)
    assert concise.err == "plant.msnn.yaml:23:17: error[E0301]: unknown name `kk`\n"
    github = msnn("check", "--format", "github", SPEC)
    assert github.err.startswith("::error title=E0301,file=plant.msnn.yaml,line=23,")


def test_json_is_versioned_and_complete(msnn: CommandLine, project: Path):
    (project / "broken.yaml").write_text("msnn: 1\nname: a\n")
    said = msnn("check", "--format", "json", SPEC, "broken.yaml")
    assert said.code == 1
    record = json.loads(said.out)
    assert record["version"] == 1
    good, bad = record["files"]
    assert good["ok"] is True
    assert good["summary"] + "\n" == SUMMARY
    assert bad["ok"] is False
    assert {d["code"] for d in bad["diagnostics"]} == {"E0203"}


def test_every_file_is_checked_though_one_is_broken(msnn: CommandLine, project: Path):
    (project / "broken.yaml").write_text("[")
    said = msnn("check", "broken.yaml", SPEC, "missing.yaml")
    assert said.code == 1
    assert said.out == SUMMARY
    assert "cannot read missing.yaml: no such file" in said.err


def test_windows_in_messages_are_not_taken_for_markup(msnn: CommandLine, project: Path):
    change(project, "next(x)", "next(x) + [bold]x[t+1]")
    said = msnn("check", SPEC)
    assert said.code == 1
    assert "next(x) + [bold]x[t+1]" in said.err


@pytest.mark.parametrize(
    ("variable", "value", "colored"),
    [("FORCE_COLOR", "1", True), ("FORCE_COLOR", "0", False), ("NO_COLOR", "1", False)],
)
def test_colour_is_asked_for_by_the_environment(
    msnn: CommandLine,
    project: Path,
    monkeypatch: pytest.MonkeyPatch,
    variable: str,
    value: str,
    colored: bool,
):
    change(project, "k*x", "kk*x")
    monkeypatch.setenv(variable, value)
    assert ("\x1b[" in msnn("check", SPEC).err) is colored


def test_strict_units_refuses_what_else_is_a_warning(msnn: CommandLine, project: Path):
    change(project, "unit: N/m,", "unit: N,")
    gradual = msnn("check", SPEC)
    assert gradual.code == 0
    assert "warning[W05" in gradual.err
    strict = msnn("check", "--strict-units", SPEC)
    assert strict.code == 1
    assert "warning[W05" in strict.err
    assert "error[E0506]: units do not fit, and --strict-units refuses" in strict.err


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("    epochs: 80", "    epochs: 80\n    freeze: [kk]", "error[E0908]: `kk` fits no learn"),
        ("    epochs: 80", "    epochs: 80\n    lr: {q: 2}", "error[E0908]: `q` fits no learn"),
        ("    epochs: 80", "    epochs: 80\n    losses: {x_nxt: 2}", "unknown loss `x_nxt`"),
        ("{patience: 20}", "{patience: 20, monitor: y}", "unknown loss `y`"),
        ("horizon: 2 s, ", "horizon: 2 s, close: [F], ", "cannot close `F`: no output predicts it"),
        ("of: x_next", "of: x_nxt", "`x_nxt` is neither an output nor a loss"),
        ("max: 3 mm", "max: 3 mm, data: tset", "error[E0953]: `data:` makes no set `tset`"),
        ("max: 3 mm", "max: 3 kg", "the limit 3 kg does not compare with a metric in m"),
        ("time: time", "time: time\n  columns: {G: F}", "error[E0952]: a column for `G`"),
        # the names exchanged
        (
            "time: time",
            "time: time\n  columns: {G: F}",
            "its column on the right: `columns: {F: G}`",
        ),
        ("train: data/train", "learn: data/train", "error[E0953]: `data:` makes no set `train`"),
        ("{dtype: float32}", "{outputs: [y]}", "error[E0950]: unknown output `y`"),
        (
            "{dtype: float32}",
            "{close: [F]}",
            "error[E0706]: `F` cannot be closed: no output predicts it",
        ),
        ("c: {dtype: float32}", "casadi: {dtype: float32}", "error[E0951]: CasADi computes"),
    ],
)
def test_the_workflow_must_fit_the_model(
    msnn: CommandLine, project: Path, old: str, new: str, expected: str
):
    change(project, old, new)
    if "learn:" in new:
        change(project, "  split: {val: 0.25, by: file}", "")
    said = msnn("check", SPEC)
    assert said.code == 1
    assert expected in said.err
    assert "--> plant.msnn.yaml:" in said.err


def test_training_without_data_is_found(msnn: CommandLine, project: Path):
    text = (project / SPEC).read_text()
    start, end = text.index("data:\n"), text.index("train:\n")
    (project / SPEC).write_text(text[:start] + text[end:])
    said = msnn("check", SPEC)
    assert said.code == 1
    assert "error[E0954]: `train:` needs data" in said.err
    assert "error[E0954]: `validate:` needs data" in said.err
