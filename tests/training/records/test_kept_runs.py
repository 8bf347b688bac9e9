"""A run keeps its model: every verb takes its folder, also on a machine that has nothing else."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn.cli.application import run as command
from msnn.data.dataset import FloatArray
from spec_schema.diagnostics.diagnostic import SpecError
from tests.training.cases import gain_series

PART = """
msnn: 1
name: scale
sample_time: 1 s
inputs: {v: m}
parameters: {g: {init: 2, unit: 1}}
outputs: {w: {expr: g*v, unit: m}}
"""
SPEC = """
msnn: 1
name: whole
sample_time: 1 s
use: {scale: {spec: ../parts/scale.yaml, weights: ../parts/scale.safetensors, freeze: all}}
connect: {scale.v: u}
inputs: {x: m, u: m}
parameters: {a: 0.5}
outputs:
  x_next: {expr: "a*x + scale.w", predicts: "x[t+1]", unit: m}
data: {source: {train: data.csv}}
train: [{epochs: 300, optimizer: {adam: {lr: 0.1}}, engine: torch}]
validate: [{of: x_next}]
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The project in which a run was trained with `--set`, from the folder above."""
    folder = tmp_path / "project"
    for name in ("parts", "models"):
        (folder / name).mkdir(parents=True)
    (folder / "parts" / "scale.yaml").write_text(PART)
    from msnn.model.weights.weights_file import write_weights

    part = msnn.load(folder / "parts" / "scale.yaml")
    write_weights(folder / "parts" / "scale.safetensors", {"g": np.array(0.3)}, part.program)
    series = gain_series(60)
    _write(folder / "models" / "data.csv", series)
    (folder / "models" / "whole.yaml").write_text(SPEC)
    monkeypatch.chdir(folder)
    assert command(["train", "models/whole.yaml", "--set", "train.0.epochs=3"]) == 0
    return folder


def _write(file: Path, series: dict[str, FloatArray]) -> None:
    rows = zip(series["x"], series["u"], strict=True)
    file.write_text("x,u\n" + "".join(f"{float(x)!r},{float(u)!r}\n" for x, u in rows))


def test_a_run_is_read_where_it_lies(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = project / "runs" / "whole" / "latest"
    assert {path.name for path in (run / "parts").iterdir()} == {
        "scale.msnn.yaml",
        "scale.safetensors",
    }
    here, there = msnn.load(run), msnn.load(project / "models" / "whole.yaml")
    assert here.program == there.program
    assert here.spec.train[0].epochs == 3  # as `--set` had it
    assert msnn.load(run / "spec.msnn.yaml").program == there.program
    assert msnn.load(run, ["train.0.epochs=7"]).spec.train[0].epochs == 7
    # the model of another run: what was kept is still what was trained
    assert msnn.initial_weights(msnn.load(run, ["parameters.a=0.75"])) == {"a": 0.75}
    assert command(["validate", str(run)]) == 0  # finds the data beside the spec
    said = capsys.readouterr()
    assert f"weights: {run.parent / run.readlink() / 'weights.safetensors'}" in said.err


def test_every_verb_takes_a_run_on_another_machine(
    project: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    program = msnn.load(project / "models" / "whole.yaml").program
    other = tmp_path / "other"
    shutil.copytree(project / "runs" / "whole" / "latest", other / "run")
    data = tmp_path / "data"
    data.mkdir()
    shutil.copy(project / "models" / "data.csv", data)
    shutil.rmtree(project)
    monkeypatch.chdir(other)
    assert msnn.load("run").program == program
    root = ["--data-root", str(data)]
    for words in (
        ["check", "run"],
        ["check", "run/spec.msnn.yaml"],
        ["compile", "run"],
        ["show", "run"],
        ["show", "run", "--interface"],
        ["show", "run", "--resolved"],
        ["diff", "run", "build/whole.program.json"],
        ["export", "run", "--to", "c,onnx"],
        ["simulate", "run", *root],
        ["validate", "run", *root],
        ["train", "run", *root],
    ):
        assert command(words) == 0, words
    capsys.readouterr()
    again = json.loads((other / "runs" / "whole" / "latest" / "run.json").read_text())
    assert again["settings"] == ["train.0.epochs=3"]
    assert command(["validate", "run"]) == 1
    said = capsys.readouterr().err
    assert f"the run does not keep its data: it read them from {project / 'models'}" in said
    assert "`--data-root FOLDER`" in said


def test_files_of_validate_that_a_run_does_not_keep_are_told_as_its_data_are(
    project: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    entry = "validate.0.files=data.csv"
    assert command(["train", "models/whole.yaml", "--set", "train.0.epochs=3", "--set", entry]) == 0
    run = tmp_path / "elsewhere" / "run"
    shutil.copytree(project / "runs" / "whole" / "latest", run)
    shutil.rmtree(project)
    monkeypatch.chdir(run.parent)
    capsys.readouterr()
    assert command(["validate", "run"]) == 1
    said = capsys.readouterr().err
    assert f"the run does not keep its data: it read them from {project / 'models'}" in said
    assert "say where they are: `--data-root FOLDER`" in said


@pytest.mark.parametrize("file", ["spec.msnn.yaml", "parts/scale.msnn.yaml", "run.json"])
def test_a_run_that_is_not_what_was_trained_is_refused(file: str, project: Path) -> None:
    run = project / "runs" / "whole" / "latest"
    text = (run / file).read_text()
    (run / file).write_text("{}" if file == "run.json" else text + "\n# edited\n")
    with pytest.raises(SpecError) as caught:
        msnn.load(run)
    assert [found.code for found in caught.value.diagnostics] == ["E0929"]


def test_weights_of_a_part_that_were_changed_are_refused(project: Path) -> None:
    run = project / "runs" / "whole" / "latest"
    part = msnn.load(run / "parts" / "scale.msnn.yaml")
    from msnn.model.weights.weights_file import write_weights

    write_weights(run / "parts" / "scale.safetensors", {"g": np.array(5.0)}, part.program)
    with pytest.raises(SpecError) as caught:
        msnn.load(run)
    assert "E0929" in [found.code for found in caught.value.diagnostics]


def test_a_folder_that_is_no_run_names_those_in_it(project: Path) -> None:
    with pytest.raises(SpecError) as caught:
        msnn.load(project / "runs" / "whole")
    (found,) = caught.value.diagnostics
    assert found.code == "E0980"
    assert str((project / "runs" / "whole" / "latest").resolve().name) in str(found.help)


def test_weights_of_an_earlier_training_are_told_from_a_newer_one_that_was_killed(
    project: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = project / "runs" / "whole"
    killed = runs / "2999-01-01_00-00-00"
    shutil.copytree(runs / "latest", killed)
    (killed / "checkpoint.safetensors").write_bytes(b"")
    capsys.readouterr()
    assert command(["export", "models/whole.yaml", "--to", "c"]) == 0
    said = capsys.readouterr().err
    assert f"a newer training has not ended: {killed.relative_to(project)}" in said
    assert command(["export", str(killed), "--to", "c"]) == 0
    assert "W0910" not in capsys.readouterr().err
    (runs / "latest").unlink()
    assert command(["export", "models/whole.yaml", "--to", "c"]) == 1
    assert "has not ended: `msnn train SPEC --resume` goes on" in capsys.readouterr().err
