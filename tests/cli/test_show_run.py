"""`msnn show RUN`: what a training reached, read from its files without trust."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from msnn.api import models, trainings
from msnn.model.load import with_engine
from msnn.training.records.progress import EpochEnd, Silent
from msnn.training.training_result import TrainingInterruptedError
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC, change

LATEST = Path("runs/plant/latest")


@pytest.fixture
def run(msnn: CommandLine, project: Path) -> Path:
    """The folder of a short training."""
    assert msnn("train", SPEC, "--set", "train.0.epochs=4").code == 0
    return LATEST.parent / LATEST.readlink()


def test_a_finished_run(msnn: CommandLine, run: Path):
    said = msnn("show", "runs/plant/latest")
    assert (said.code, said.err) == (0, "")
    sections = said.out.rstrip().split("\n\n")
    # four epochs of short steps hardly move the parameters, which one section says
    head, stages, parameters, commands = (each for each in sections if "W0937" not in each)
    facts = dict(line.split("  ", 1) for line in head.splitlines())
    assert facts["run"].strip() == str(run)
    assert facts["model"].strip() == "plant: finished"
    assert facts["spec"].strip().startswith(f"{SPEC}, --set train.0.epochs=4, sha256 ")
    assert facts["data"].strip() == "10 records, rows: train 1200, test 400, val 400"
    assert stages.splitlines()[1].split()[:2] == ["fit", "4"]
    assert "std. error" in parameters.splitlines()[0]
    assert "N*s/m" in parameters
    assert "resume" not in commands
    for line in commands.splitlines()[1:]:
        verb, *words = shlex.split(line)
        assert words[:3] == ["msnn", verb, SPEC]
        assert msnn(*words[1:], "--data-root" if verb == "validate" else "--out", ".").code in (
            0,
            3,
        )


def test_the_commands_of_a_run_that_was_taken_elsewhere(
    msnn: CommandLine, run: Path, project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    taken = tmp_path / "elsewhere" / "taken along"
    shutil.copytree(run, taken)
    monkeypatch.chdir(taken.parent)
    commands = json.loads(msnn("show", taken.name, "--format", "json").out)["commands"]
    assert commands == {verb: f"msnn {verb} 'taken along'" for verb in ("validate", "export")}
    said = msnn(*shlex.split(commands["validate"])[1:], "--data-root", str(project))
    assert said.code in (0, 3), said.err
    assert msnn(*shlex.split(commands["export"])[1:], "--to", "torch", "--out", ".").code == 0


def test_as_json(msnn: CommandLine, run: Path):
    record = json.loads(msnn("show", str(run), "--format", "json").out)
    assert record["state"] == "finished"
    assert ["W0937" in warning for warning in record["warnings"]] == [True]
    (stage,) = record["stages"]
    assert (stage["stage"], stage["epochs"], stage["reason"]) == ("fit", 4, "done")
    assert stage["losses"]["x_next"] > 0
    c = record["parameters"][0]
    assert (c["name"], c["unit"], c["initial"], c["learn"], c["at_bound"]) == (
        ("c", "N*s/m", [2.0], True, False)
    )
    assert len(c["standard_errors"]) == 1
    assert record["run"]["settings"] == ["train.0.epochs=4"]


def test_drawn(msnn: CommandLine, run: Path):
    assert msnn("show", str(run), "--plot", "loss.svg").code == 0
    assert Path("loss.svg").read_bytes().startswith(b"<?xml")


def test_a_spec_that_has_changed_is_said(msnn: CommandLine, project: Path, run: Path):
    change(project, "doc: stiffness", "doc: how stiff")
    assert "the file has changed since" in msnn("show", str(run)).out


class Interrupting(Silent):
    """Sends Ctrl-C to this process after the second epoch."""

    def epoch_ended(self, event: EpochEnd) -> None:
        if event.epoch == 2:
            os.kill(os.getpid(), signal.SIGINT)


def test_an_interrupted_run_says_how_it_goes_on(msnn: CommandLine, project: Path):
    model = with_engine(models.load(SPEC, ["train.0.epochs=5"]), "torch")
    with pytest.raises(TrainingInterruptedError):
        trainings.train(model, runs="other runs", progress=Interrupting())
    record = json.loads(msnn("show", "other runs/plant/latest", "--format", "json").out)
    assert record["state"] == "interrupted"
    assert record["stages"][0]["reason"] == "at epoch 2 of 5"
    words = shlex.split(record["commands"]["resume"])
    assert words[1:] == ["train", SPEC, "--resume", *words[4:8], "--out", "other runs"]
    assert words[4:8] == ["--set", "train.0.epochs=5", "--set", "train.0.engine=torch"]
    assert msnn(*words[1:]).code == 0
    said = msnn("show", "other runs/plant/latest").out
    assert "plant: finished" in said
    assert "resume" not in said


def interrupted() -> Path:
    """The folder of a training that Ctrl-C ended."""
    model = with_engine(models.load(SPEC, ["train.0.epochs=5"]), "torch")
    with pytest.raises(TrainingInterruptedError) as caught:
        trainings.train(model, progress=Interrupting())
    folder = caught.value.result.folder
    assert folder is not None
    return folder


def test_an_interrupted_run_that_was_taken_elsewhere_goes_on_there(
    msnn: CommandLine, project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    taken = tmp_path / "elsewhere" / "taken along"
    shutil.copytree(interrupted(), taken)
    monkeypatch.chdir(taken.parent)
    command = json.loads(msnn("show", taken.name, "--format", "json").out)["commands"]["resume"]
    assert command == "msnn train 'taken along' --resume"
    said = msnn(*shlex.split(command)[1:], "--data-root", str(project))
    assert said.code == 0, said.err
    assert "kept in taken along" in said.out
    record = json.loads(msnn("show", taken.name, "--format", "json").out)
    assert (record["state"], record["stages"][0]["epochs"]) == ("finished", 5)
    # it is none of the trainings here, which have their own `latest`
    assert {path.name for path in taken.parent.rglob("*") if path.is_symlink()} == set()
    (line,) = (taken.parent / "runs" / "runs.jsonl").read_text().splitlines()
    assert Path(json.loads(line)["folder"]) == taken


def test_an_interrupted_run_goes_on_under_the_name_latest(msnn: CommandLine, project: Path):
    run = interrupted()
    assert LATEST.resolve() == run.resolve()
    said = msnn("train", str(LATEST), "--resume")
    assert said.code == 0, said.err
    # the link still leads to the run, not to itself
    assert LATEST.resolve() == run.resolve()
    assert json.loads(msnn("show", str(LATEST), "--format", "json").out)["state"] == "finished"


def test_of_two_interrupted_runs_the_one_that_is_named_goes_on(msnn: CommandLine, project: Path):
    first, second = interrupted(), interrupted()
    commands = [
        json.loads(msnn("show", str(run), "--format", "json").out)["commands"]["resume"]
        for run in (first, second)
    ]
    assert commands[0] == f"msnn train {first} --resume"
    assert commands[1].startswith(f"msnn train {SPEC} --resume --set")
    assert msnn(*shlex.split(commands[0])[1:]).code == 0
    states = [
        json.loads(msnn("show", str(run), "--format", "json").out)["state"]
        for run in (first, second)
    ]
    assert states == ["finished", "interrupted"]
    assert LATEST.resolve() == first.resolve()


def test_why_a_run_diverged_is_kept(msnn: CommandLine, project: Path):
    change(project, "a: (F - c*v - k*x) / m  ", "a: (F - c*v - k*x) / m + 1e9*exp(1e3*x*x)")
    assert msnn("train", SPEC).code == 4
    (run,) = Path("runs/plant").glob("2*")
    record = json.loads(msnn("show", str(run), "--format", "json").out)
    assert record["state"] == "diverged"
    assert "error[E0" in record["warnings"][-1]
    assert "not finite" in record["warnings"][-1]


def test_a_folder_that_is_no_run_says_which_are(msnn: CommandLine, run: Path):
    said = msnn("show", "runs/plant")
    assert said.code == 1
    assert said.err == (
        "error[E0980]: runs/plant is no training run: there is no run.json\n"
        f" = help: there are runs in it: {run}\n"
    )
    assert "a run is in `runs/NAME/TIME`" in msnn("show", "data").err


def cut(path: Path) -> None:
    path.write_text(path.read_text()[:-20])


def emptied(path: Path) -> None:
    path.write_text("{}\n")


def other_types(path: Path) -> None:
    path.write_text('{"parameters": 3, "format": 1}\n')


@pytest.mark.parametrize("name", ["run.json", "metrics.jsonl", "parameters.json"])
@pytest.mark.parametrize("spoil", [cut, emptied, other_types])
def test_spoiled_files_are_no_bug(
    name: str, spoil: Callable[[Path], None], msnn: CommandLine, run: Path
):
    spoil(run / name)
    said = msnn("show", str(run))
    assert said.code == 1
    assert "error[E098" in said.err


@pytest.mark.parametrize(
    "words",
    [
        ("runs/plant/latest", "--program", "--windows"),
        (SPEC, "--plot", "a.png"),
        ("runs/plant/latest", "--plot", "a.xyz"),
    ],
)
def test_what_does_not_fit_is_a_usage_error(words: tuple[str, ...], msnn: CommandLine, run: Path):
    assert msnn("show", *words).code == 2


def test_a_parameter_at_its_bound_is_among_the_warnings(msnn: CommandLine, project: Path):
    change(project, "k: {init: 10,", "k: {init: 10, max: 10.001,")
    msnn("train", SPEC)
    said = msnn("show", "runs/plant/latest").out
    assert "warning[W0904]: `k` ended at its bound" in said


def test_a_report_takes_the_place_of_no_spec(msnn: CommandLine, project: Path) -> None:
    """`-o` and the spec are easily mixed up; a usage error comes before anything is read."""
    before = Path(SPEC).read_bytes()
    found = msnn("report", str(LATEST), "-o", SPEC)
    assert found.code == 2
    assert "does not end with .html" in found.err
    assert Path(SPEC).read_bytes() == before


@pytest.mark.parametrize(("writer", "is_told"), [("9.0.0", True), (None, False)])
def test_a_run_of_another_version_names_the_one_that_reads_it(
    writer: str | None, is_told: bool, msnn: CommandLine, run: Path
):
    file = run / "run.json"
    description = json.loads(file.read_text(encoding="utf-8")) | {"format": 2}
    if writer is not None:
        description["versions"]["msnn"] = writer
    file.write_text(json.dumps(description), encoding="utf-8")
    said = msnn("show", str(run))
    assert said.code == 1
    assert "error[E0981]" in said.err
    assert ("msnn 9.0.0 has written them, and reads them" in said.err) is is_told
    assert ("has written" in said.err) is is_told
