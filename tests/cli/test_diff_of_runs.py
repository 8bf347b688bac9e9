"""`msnn diff` of two runs: metrics, learned numbers, what breaks users, and how it ends."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from safetensors.numpy import load_file

from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC, change

OLD, NEW = "old/plant/latest", "runs/plant/latest"


@pytest.fixture(scope="module")
def old_runs(made_project: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder `runs` after a short training of the new project."""
    from msnn.api import models, trainings

    folder = tmp_path_factory.mktemp("old")
    model = models.load(made_project / SPEC, ["train.0.epochs=3"])
    trainings.train(model, runs=folder / "old")
    return folder / "old"


@pytest.fixture
def old(project: Path, old_runs: Path) -> Path:
    """The project with that run in `old`."""
    shutil.copytree(old_runs, project / "old", symlinks=True)
    return project


def test_a_run_and_itself_are_the_same(msnn: CommandLine, old: Path):
    said = msnn("diff", OLD, OLD, "--data-root", ".", "--fail-on", "any,breaking,worse")
    assert (said.code, said.err) == (0, "")
    assert "the same; no metric is worse" in said.out
    record = json.loads(msnn("diff", OLD, OLD, "--data-root", ".", "--format", "json").out)
    assert [row["growth"] for row in record["metrics"]] == [0.0, 0.0]
    assert [each["name"] for each in record["learned"]] == ["c", "k", "m"]
    assert (record["worse"], record["breaking"]) == (False, False)


def test_a_worse_metric_ends_with_3_at_its_line(msnn: CommandLine, old: Path):
    assert msnn("train", SPEC, "-q", "--set", "train.0.epochs=1").code == 0
    said = msnn("diff", OLD, NEW, "--data-root", ".", "--fail-on", "worse", "--format", "github")
    assert said.code == 3
    assert said.err.count(f"::error title=E0871,file={SPEC},line=") == 2
    assert "WORSE" in said.out
    record = json.loads(msnn("diff", OLD, NEW, "--data-root", ".", "--format", "json").out)
    weights = [load_file(run / "weights.safetensors") for run in (Path(OLD), Path(NEW))]
    assert [(each["name"], each["old"], each["new"]) for each in record["learned"]] == [
        (name, *(float(of[name]) for of in weights)) for name in ("c", "k", "m")
    ]
    allowed = msnn("diff", OLD, NEW, "--data-root", ".", "--fail-on", "worse", "--margin", "1e6")
    assert allowed.code == 0
    assert msnn("diff", NEW, OLD, "--data-root", ".", "--fail-on", "worse").code == 0


def test_a_breaking_change_ends_with_1_and_a_harmless_one_with_0(msnn: CommandLine, old: Path):
    change(old, "unit: N, range: [-10, 10]", "unit: kN, range: [-10, 10]")
    shutil.copy(old / SPEC, "broken.yaml")
    said = msnn("diff", OLD, "broken.yaml", "--fail-on", "breaking", "--format", "sarif")
    assert said.code == 1
    (result,) = json.loads(said.out)["runs"][0]["results"]
    assert result["ruleId"] == "E0872"
    assert result["message"]["text"].startswith("input F: unit N → kN\nnumbers mean something")
    change(old, "unit: kN, range: [-10, 10]", "unit: N, range: [-12, 10]")
    said = msnn("diff", OLD, SPEC, "--fail-on", "breaking", "--summary", "page.md")
    assert said.code == 0
    assert "-10 … 10  -12 … 10\n" in said.out
    page = (old / "page.md").read_text()
    assert page.startswith("## plant: the models differ\n\n| interface |")
    assert "<details><summary>Changes of the spec" in page


def test_without_data_metrics_are_left_out_unless_they_decide(msnn: CommandLine, old: Path):
    shutil.rmtree(old / "data")
    said = msnn("diff", OLD, OLD, "--data-root", ".")
    assert said.code == 0
    assert "warning[W0873]: metrics of the old run are missing: no data file matches" in said.err
    assert "metric" not in said.out
    assert msnn("diff", OLD, OLD, "--data-root", ".", "--fail-on", "worse").code == 1


@pytest.mark.parametrize("words", ["worst", "worse,nothing", ""])
def test_a_word_that_fail_on_does_not_have(msnn: CommandLine, project: Path, words: str):
    said = msnn("diff", SPEC, SPEC, "--fail-on", words)
    assert said.code == 2
    assert "is none of any, breaking, worse, never" in said.err


def test_specs_have_no_metrics_to_be_worse(msnn: CommandLine, project: Path):
    assert msnn("diff", SPEC, SPEC, "--fail-on", "worse").code == 2
