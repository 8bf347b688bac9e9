"""A run keeps files of `init: {file: …}`: it needs none of them, and notices one that changed."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn.cli.application import run as command
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.training.training_result import TrainingInterruptedError
from spec_schema.diagnostics.diagnostic import SpecError
from tests.training.cases import gain_series
from tests.training.records.test_interruption import Interrupting

PART = """
msnn: 1
name: scale
sample_time: 1 s
inputs: {v: m}
layers: {f: {fir: {window: 2, init: {file: ../numbers/f.txt}}}}
outputs: {w: {expr: f(v), unit: m}}
"""
SPEC = """
msnn: 1
name: whole
sample_time: 1 s
use: {scale: {spec: ../parts/scale.yaml}}
connect: {scale.v: u}
inputs: {x: m, u: m}
parameters: {a: {init: {file: a.txt}}, b: {init: {file: %s}}}
outputs:
  x_next: {expr: "a*x + b*u + scale.w", predicts: "x[t+1]", unit: m}
data: {source: {train: data.csv}}
train: [{epochs: 3, optimizer: {adam: {lr: 0.1}}, engine: torch}]
validate: [{of: x_next}]
"""
FILES = {"models/a.txt": "0.5\n", "parts/../numbers/f.txt": "0.1 0.2\n", "absolute.txt": "0.3"}


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project whose initial values stand in three files, one named by its whole path."""
    folder = tmp_path / "project"
    for name in ("parts", "models", "numbers"):
        (folder / name).mkdir(parents=True)
    for name, text in FILES.items():
        (folder / name).write_text(text)
    (folder / "parts" / "scale.yaml").write_text(PART)
    (folder / "models" / "whole.yaml").write_text(SPEC % (folder / "absolute.txt"))
    series = gain_series(60)
    table = np.column_stack([series["x"], series["u"]])
    np.savetxt(folder / "models" / "data.csv", table, delimiter=",", header="x,u", comments="")
    monkeypatch.chdir(folder)
    return folder


def test_a_run_does_without_its_files_of_numbers(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert command(["train", "models/whole.yaml"]) == 0
    program = msnn.load("models/whole.yaml").program
    assert command(["compile", "models/whole.yaml"]) == 0
    for name in FILES:
        (project / name).unlink()
    run = project / "runs" / "whole" / "latest"
    for words in (
        ["validate", str(run)],
        ["export", str(run), "--to", "c"],
        ["train", str(run)],
        ["show", "build/whole.program.json"],
    ):
        assert command(words) == 0, words
    assert msnn.load(run).program == program
    other = tmp_path / "other"
    shutil.copytree(run, other / "run")
    shutil.rmtree(project)
    monkeypatch.chdir(other)
    assert msnn.load("run").program == program


@pytest.mark.parametrize("name", FILES)
def test_a_changed_file_of_numbers_is_not_resumed_over(name: str, project: Path) -> None:
    model = msnn.load("models/whole.yaml")
    with pytest.raises(TrainingInterruptedError):
        msnn.train(model, progress=Interrupting("stage_1", 1))
    (project / name).write_text(FILES[name].replace("0.", "0.7"))
    with pytest.raises(SpecError, match="E0946") as caught:
        msnn.train(msnn.load("models/whole.yaml"), resume=True)
    (found,) = caught.value.diagnostics
    assert f"the numbers of `{_kept_as(project, name)}` changed" in "\n".join(found.notes)
    # of the run itself nothing has changed
    run = os.path.realpath("runs/whole/latest")
    assert msnn.load(run).program == model.program


def _kept_as(project: Path, name: str) -> str:
    run = project / "runs" / "whole" / "latest" / "parts"
    return next(file.name for file in run.iterdir() if file.name.endswith(Path(name).name))


def test_numbers_of_a_run_that_were_changed_are_refused(project: Path) -> None:
    assert command(["train", "models/whole.yaml"]) == 0
    run = project / "runs" / "whole" / "latest"
    (run / "parts" / _kept_as(project, "models/a.txt")).write_text("0.9\n")
    with pytest.raises(SpecError) as caught:
        msnn.load(run)
    assert [found.code for found in caught.value.diagnostics] == ["E0929"]


def test_a_copy_of_weights_belongs_to_the_part_whose_initial_values_stand_in_a_file(
    project: Path,
) -> None:
    trained = PART + "data: {source: {train: part.csv}}\n"
    trained = trained.replace("unit: m}}", 'unit: m, predicts: "w_log[t]"}}\ntargets: {w_log: m}')
    trained += "train: [{epochs: 1}]\n"
    (project / "parts" / "scale.yaml").write_text(trained)
    table = np.arange(40.0).reshape(20, 2)
    np.savetxt(project / "parts/part.csv", table, delimiter=",", header="v,w_log", comments="")
    assert command(["train", "parts/scale.yaml"]) == 0
    weights = project / "runs" / "scale" / "latest" / "weights.safetensors"
    shutil.copy(weights, project / "parts" / "scale.safetensors")
    whole = project / "models" / "whole.yaml"
    named = "scale.yaml, weights: ../parts/scale.safetensors}"
    whole.write_text(whole.read_text().replace("scale.yaml}", named))
    assert [found.code for found in msnn.load(whole).warnings] == []
    assert command(["train", "models/whole.yaml"]) == 0
    for name in FILES:
        (project / name).unlink()
    run = msnn.load(project / "runs" / "whole" / "latest")
    assert [found.code for found in run.warnings] == []


CONTROLLED = """
msnn: 1
name: controlled
sample_time: 1 s
inputs: {u: {between: hold}}
parameters: {a: {init: {file: a.txt}}}
states: {x: {next: a * x + u, init: x.meas}}
outputs: {x_next: {expr: next(x), predicts: "x[t+1]"}}
mpc:
  horizon: 3
  controls: [u]
  cost: {stage: x**2 + u**2}
"""


def test_the_controller_of_a_program_file_does_without_files_of_numbers(project: Path) -> None:
    spec = project / "models" / "controlled.yaml"
    spec.write_text(CONTROLLED)
    assert command(["compile", str(spec)]) == 0
    before = msnn.mpc(msnn.load(spec)).solve({"x": 1.0})
    (project / "models" / "a.txt").unlink()
    model = msnn.load(project / "build" / "controlled.program.json")
    control = model.of(ControlProblem)
    assert control is not None
    assert control.program.spec_hash == model.program.spec_hash
    assert msnn.mpc(model).solve({"x": 1.0}).control == before.control
