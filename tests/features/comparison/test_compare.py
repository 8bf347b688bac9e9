"""Comparisons from end to end: what is trained, what is not again, what becomes of faults."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import msnn as api
from msnn.features.comparison.local_workers import outcomes
from msnn.features.comparison.trial import Trial, TrialOutcome, missing_tools
from msnn.project.new_project import new_project
from msnn.training.records.run_log import LOG, read
from spec_schema.diagnostics.diagnostic import SpecError
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC

SHORT = ("--set", "train.0.epochs=2", "--no-cost", "--jobs", "1")


@pytest.fixture
def msnn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> CommandLine:
    """The command line in a fresh project."""
    folder = new_project(tmp_path / "plant")
    monkeypatch.chdir(folder)
    return CommandLine(folder, capsys)


def test_choices_are_trained_ranked_and_logged(msnn: CommandLine):
    said = msnn("compare", SPEC, "--grid", "train.0.epochs=1,8", "--no-cost", "--jobs", "1")
    assert said.code == 0
    rows = said.out.splitlines()
    assert rows[1].startswith("epochs=8")
    assert "best, Pareto front" in rows[1]
    assert rows[2].startswith("epochs=1")
    lines = read(Path("runs") / LOG)
    assert [line.settings for line in lines] == [("train.0.epochs=1",), ("train.0.epochs=8",)]
    # what the table says is what `validate` finds of the kept run
    best = lines[1]
    assert best.folder is not None
    report = json.loads(
        msnn(
            "validate",
            f"runs/{best.folder}",
            "--format",
            "json",
            "--set",
            "validate.0.data=val",
            "--set",
            "validate.0.max=1",
        ).out
    )
    assert best.held_out[0].metrics["rmse"] == report["metrics"][0]["value"]
    assert not list(Path("runs").rglob("checkpoint.safetensors"))
    assert not (Path("runs") / "plant" / "latest").exists()


def test_numbers_that_no_stage_moves_are_not_counted(msnn: CommandLine):
    """Mass, damping and stiffness are learned; two that are held count as constants."""
    held = "train.0.freeze=[m, c]"
    assert _aic() - _aic(held) == pytest.approx(4)
    assert msnn("compare", SPEC, "--set", held, *SHORT).code == 0
    assert [line.parameters for line in read(Path("runs") / LOG)] == [1]


def _aic(*settings: str) -> float:
    """With the initial weights, whatever the settings are."""
    model = api.load(SPEC, settings=("validate.0={of: x_next, metric: aic}", *settings))
    return api.validate(model, api.initial_weights(model)).rows[0].value


def test_what_the_log_has_is_not_trained_again(msnn: CommandLine):
    first = msnn("compare", SPEC, "--grid", "train.0.epochs=1,2", *SHORT[2:])
    again = msnn("compare", SPEC, "--grid", "train.0.epochs=2,3", *SHORT[2:])
    assert (first.code, again.code) == (0, 0)
    assert "epochs=2: done" in again.err
    assert again.err.count("trained before") == 1
    assert len(read(Path("runs") / LOG)) == 3
    # other data are another training
    log = sorted(Path("data/train").glob("*.csv"))[0]
    shutil.copy(log, log.with_name("zz.csv"))
    assert "trained before" not in msnn("compare", SPEC, *SHORT).err


def test_folds_that_were_trained_before_have_what_the_table_shows(msnn: CommandLine):
    asked = ("--folds", "--set", "data.split={by: kfold, k: 2}", *SHORT[:2])
    assert msnn("train", SPEC, *asked).code == 0
    said = msnn("compare", SPEC, *asked, "--no-cost", "--jobs", "1")
    assert said.err.count("trained before") == 2
    fresh = msnn("compare", SPEC, *asked, "--no-cost", "--jobs", "1", "--out", "fresh")
    table, new = (text.out.splitlines() for text in (said, fresh))
    assert table[0].split() == new[0].split()
    assert "AIC/n" in table[0]
    assert "AIC/n" in msnn("compare", SPEC, *asked, "--no-cost", "--jobs", "1").out


def test_folders_of_runs_and_program_files_are_compared(msnn: CommandLine):
    assert msnn("train", SPEC, *SHORT[:2]).code == 0
    assert msnn("compile", SPEC).code == 0
    program = "build/plant.program.json"
    said = msnn("compare", "runs/plant/latest", program, *SHORT)
    assert said.code == 0, said.err
    assert [line.split()[0] for line in said.out.splitlines()[1:]] == ["latest", "plant"]


def test_what_is_no_longer_kept_is_trained_again(msnn: CommandLine):
    first = msnn("compare", SPEC, *SHORT)
    shutil.rmtree("runs/plant")
    again = msnn("compare", SPEC, *SHORT)
    assert "trained before" not in again.err
    assert _but_seconds(again.out) == _but_seconds(first.out)
    folder = read(Path("runs") / LOG)[-1].folder
    assert (Path("runs") / str(folder) / "weights.safetensors").is_file()


@pytest.mark.parametrize("left", [0, 1000])
def test_weights_that_cannot_be_read_are_trained_again(msnn: CommandLine, left: int):
    first = msnn("compare", SPEC, *SHORT)
    folder = Path("runs") / str(read(Path("runs") / LOG)[-1].folder)
    weights = folder / "weights.safetensors"
    whole = weights.read_bytes()
    weights.write_bytes(b"" if left == 0 else whole[:-8])
    again = msnn("compare", SPEC, *SHORT)
    assert "trained before" not in again.err
    assert _but_seconds(again.out) == _but_seconds(first.out)
    assert weights.read_bytes() == whole


def test_a_training_is_the_same_whether_python_or_the_command_line_asks(msnn: CommandLine):
    settings = (
        "--set",
        "integrator=rk4",
        "--set",
        "train.0.epochs=2",
        "--set",
        "sample_time=50 ms",
    )
    assert msnn("compare", SPEC, *settings, "--no-cost", "--jobs", "1").code == 0
    api.compare(
        SPEC,
        settings={"integrator": "rk4", "train.0.epochs": 2, "sample_time": "50 ms"},
        runs="runs",
        cost=False,
    )
    (line,) = read(Path("runs") / LOG)
    assert line.settings == ("integrator=rk4", "train.0.epochs=2", "sample_time=50 ms")


def _but_seconds(table: str) -> str:
    """The table without what a training took."""
    return re.sub(r" +[\d.]+ s ", " ", table)


def test_a_grid_over_the_number_of_folds_trains_each_number(msnn: CommandLine):
    split = ("--set", "data.split={by: kfold, k: 2}", "--grid", "data.split.k=2,3", "--folds")
    assert msnn("compare", SPEC, *split, *SHORT).code == 0
    assert [line.fold for line in read(Path("runs") / LOG)] == [1, 2, 1, 2, 3]


def test_processes_reach_the_same_as_one(msnn: CommandLine):
    grid = ("--grid", "train.0.epochs=1,2,3", "--seeds", "2", "--no-cost", "--format", "json")
    alone = json.loads(msnn("compare", SPEC, *grid, "--jobs", "1", "--out", "one").out)
    both = json.loads(msnn("compare", SPEC, *grid, "--jobs", "2", "--out", "two").out)
    assert [m["score"] for m in alone["models"]] == [m["score"] for m in both["models"]]
    assert [m["model"] for m in alone["models"]] == [m["model"] for m in both["models"]]


def test_what_is_said_does_not_depend_on_which_training_ends_first(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch
):
    def backwards(*given: Any) -> Generator[tuple[Trial, TrialOutcome]]:
        yield from reversed(list(outcomes(*given)))

    grid = ("--seeds", "3", "--no-cost", "--format", "json", *SHORT)
    first = json.loads(msnn("compare", SPEC, *grid).out)
    monkeypatch.setattr("msnn.features.comparison.compare.outcomes", backwards)
    again = json.loads(msnn("compare", SPEC, *grid).out)
    assert [run["seed"] for run in again["models"][0]["runs"]] == [0, 1, 2]
    assert first["models"] == again["models"]


def test_seeds_draw_other_orders_and_other_initial_values(msnn: CommandLine):
    spec = Path(SPEC)
    spec.write_text(
        spec.read_text().replace("c: {init: 2,", "c: {init: {uniform: {min: 1, max: 3}},")
    )
    msnn("compare", SPEC, "--seeds", "3", *SHORT)
    lines = read(Path("runs") / LOG)
    assert [line.seed for line in lines] == [0, 1, 2]
    assert len({line.monitor for line in lines}) == 3
    initial = {
        json.loads((Path("runs") / str(line.folder) / "metrics.jsonl").read_text().split("\n")[0])[
            "total"
        ]
        for line in lines
    }
    assert len(initial) == 3


def test_a_seed_is_not_the_order_that_a_setting_asks_for(msnn: CommandLine):
    spec = Path(SPEC)
    spec.write_text(
        spec.read_text().replace("c: {init: 2,", "c: {init: {uniform: {min: 1, max: 3}},")
    )
    msnn("compare", SPEC, "--grid", "train.0.seed=1", *SHORT)
    seeds = msnn("compare", SPEC, "--seeds", "2", *SHORT)  # seed 1 draws initial values too
    assert "trained before" not in seeds.err


def test_other_numbers_in_a_file_of_initial_values_are_another_training(msnn: CommandLine):
    spec = Path(SPEC)
    spec.write_text(spec.read_text().replace("c: {init: 2,", "c: {init: {file: c.csv},"))
    Path("c.csv").write_text("2\n")
    msnn("compare", SPEC, *SHORT)
    Path("c.csv").write_text("3\n")
    assert "trained before" not in msnn("compare", SPEC, *SHORT).err
    assert "trained before" in msnn("compare", SPEC, *SHORT).err


def test_folds_are_held_out_in_turn(msnn: CommandLine):
    split = ("--set", "data.split={by: kfold, k: 2}", "--folds")
    said = msnn("compare", SPEC, "--grid", "integrator=rk4,euler", *split, *SHORT)
    assert said.code == 0
    assert [(line.fold, line.settings[-1]) for line in read(Path("runs") / LOG)] == [
        (1, "integrator=rk4"),
        (2, "integrator=rk4"),
        (1, "integrator=euler"),
        (2, "integrator=euler"),
    ]
    assert "±" in said.out


def test_the_cost_is_that_of_verify(msnn: CommandLine):
    if missing_tools():
        pytest.fail("install what `.ci/run` installs: the cross compiler and QEMU")
    msnn("compare", SPEC, *SHORT[:2], "--jobs", "1")
    (line,) = read(Path("runs") / LOG)
    assert line.cost is not None
    msnn("export", f"runs/{line.folder}", "--to", "c", "--out", "build")
    said = msnn("verify", "build/c", "--targets", "m4", "--format", "json")
    board = next(each for each in json.loads(said.out)["results"] if "-O2" in each["target"])
    (figures,) = board["figures"]
    assert line.cost.instructions == pytest.approx(figures["instructions"][1])
    assert line.cost.flash == figures["flash"]


def test_mistakes_in_specs_and_grids_end_before_any_training(msnn: CommandLine):
    for wrong, code in (
        (("--grid", "train.0.epoch=1,2"), "E0201"),
        (("--grid", "train.0.epochs=1,two"), "E0204"),
        (("--grid", "train.7.epochs=1"), "E1032"),
        (("--grid", "nothing"), "E0973"),
    ):
        said = msnn("compare", SPEC, *wrong, *SHORT[2:])
        assert said.code == 1
        assert f"error[{code}]" in said.err
        assert not Path("runs").exists()


def test_a_variant_that_is_refused_leaves_the_others(msnn: CommandLine):
    said = msnn("compare", SPEC, "--grid", "equations.a=F/m - k*x/m,F + q", *SHORT)
    assert said.code == 1
    assert "error[E0" in said.err
    assert "refused" in said.out
    assert "a=F/m - k*x/m" in said.out
    assert len(read(Path("runs") / LOG)) == 1


def test_a_variant_that_diverges_leaves_the_others(msnn: CommandLine):
    choices = ("--grid", "parameters.k.init=10,-1e25")
    said = msnn("compare", SPEC, *choices, *SHORT)
    assert said.code == 0
    assert "diverged" in said.out
    assert {line.state for line in read(Path("runs") / LOG)} == {"finished", "diverged"}


def test_rows_held_out_are_asked_for(msnn: CommandLine):
    said = msnn("compare", SPEC, "--on", "nothing", *SHORT)
    assert said.code == 1
    assert "error[E0974]" in said.err
    assert not (Path("runs") / LOG).exists()


def test_an_interrupted_comparison_goes_on(msnn: CommandLine):
    """Ctrl-C to the parent alone ends its workers too; the same command trains what is left."""
    epochs = ("--set", "train.0.epochs=1500", "--set", "train.0.early_stop.patience=1500")
    command = ["compare", SPEC, "--seeds", "4", "--jobs", "2", "--no-cost", *epochs]
    program = "from msnn.cli.main import main\nif __name__ == '__main__':\n    main()\n"
    Path("run_msnn.py").write_text(program)
    paths = os.pathsep.join(path for path in sys.path if path)
    process = subprocess.Popen(
        [sys.executable, "run_msnn.py", *command],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
    )
    assert process.stderr is not None
    while "done" not in (line := process.stderr.readline()):
        assert line, "it ended before it was interrupted"
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert "interrupted; this goes on: msnn compare" in said
    assert "Traceback" not in said
    before = {line.key: line for line in read(Path("runs") / LOG)}
    assert 1 <= len(before) < 4
    again = msnn(*command[:-4], *epochs)
    assert again.code == 0
    assert again.err.count("trained before") == len(before)
    after = {line.key: line for line in read(Path("runs") / LOG)}
    assert len(after) == 4
    command[command.index("--jobs") + 1] = "1"
    alone = msnn(*command, "--out", "whole")
    assert alone.code == 0
    whole = {line.key: line for line in read(Path("whole") / LOG)}
    assert {key: line.held_out for key, line in whole.items()} == {
        key: line.held_out for key, line in after.items()
    }


def killed_in(place: Path, times: int) -> str:
    """A program whose workers are killed in the first `times` trials of seed 1."""
    return f"""
import os, signal
from collections.abc import Generator
from pathlib import Path
from typing import Any
import msnn.features.comparison.local_workers as workers
from msnn.cli.main import main
own = workers.run_trial
def fragile(trial, setup, known, readings):
    mark = Path({str(place)!r})
    if trial.seed == 1 and len(list(mark.iterdir())) < {times}:
        (mark / str(os.getpid())).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return own(trial, setup, known, readings)
workers.run_trial = fragile
if __name__ == "__main__":
    main()
"""


@pytest.mark.parametrize("times", [1, 3])
def test_a_killed_process_is_replaced_and_given_up_when_it_is_killed_again(
    msnn: CommandLine, tmp_path: Path, times: int
):
    marks = tmp_path / "marks"
    marks.mkdir()
    Path("run_msnn.py").write_text(killed_in(marks, times))
    paths = os.pathsep.join(path for path in sys.path if path)
    command = ["compare", SPEC, "--seeds", "4", "--jobs", "2", *SHORT[:3], "--format", "json"]
    said = subprocess.run(
        [sys.executable, "run_msnn.py", *command],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
        check=False,
    )
    assert said.returncode == (0 if times == 1 else 1), said.stderr
    (model,) = json.loads(said.stdout)["models"]
    ended = sorted(run["seed"] for run in model["runs"])
    assert ended == ([0, 1, 2, 3] if times == 1 else [0, 2, 3])
    assert ("error[E0977]" in said.stderr) == (times == 3)


def test_frames_are_compared_as_files_are(msnn: CommandLine):
    generator = np.random.default_rng(0)
    force = np.repeat(generator.normal(0, 3, 60), 10)
    position = np.convolve(force, np.exp(-np.arange(40) / 8.0))[: len(force)] / 100
    frame = {"F": force, "x": position, "v": np.gradient(position, 0.05)}
    sets = {"train": frame, "val": frame}
    spec = Path(SPEC)
    text = spec.read_text()
    spec.write_text("".join(line for line in text.splitlines(True) if "split:" not in line))
    found = api.compare(SPEC, grid=["train.0.epochs=1,2"], data=sets, runs=None, cost=False)
    assert found.best is not None
    assert found.folder is None
    assert not Path("runs").exists()
    with pytest.raises(SpecError):
        api.compare(SPEC, data=frame, runs=None, on="other", cost=False, grid=["train.0.epochs="])


@pytest.mark.parametrize("by", ["nope", "x_next.nope", "y.rmse", "rmse:20 steps"])
def test_a_criterion_that_nothing_measures_is_told_before_anything_is_trained(
    msnn: CommandLine, by: str
):
    said = msnn("compare", SPEC, "--by", by, *SHORT)
    assert said.code == 1
    assert "E0976" in said.err
    assert "x_next.rmse:one step" in said.err
    assert not (Path("runs") / LOG).exists()


@pytest.mark.skipif(bool(missing_tools()), reason="instructions cannot be counted here")
def test_the_c_of_a_model_is_counted_once_however_often_it_is_trained(msnn: CommandLine):
    words = ["compare", SPEC, "--set", "train.0.epochs=2", "--seeds", "2", "--jobs", "1"]
    assert msnn(*words).code == 0
    assert [line.cost is not None for line in read(Path("runs") / LOG)] == [True, False]


@pytest.mark.skipif(bool(missing_tools()), reason="instructions cannot be counted here")
def test_the_c_of_another_training_is_counted_where_the_first_does_not_end(msnn: CommandLine):
    spec = Path(SPEC)
    text = spec.read_text()
    text = text.replace("  k: {init", "  gate: {init: {uniform: {min: -1, max: 1}}}\n  k: {init")
    # infinite where a seed draws a gate above 0, as the first one does, and else 1
    spec.write_text(text.replace("c*v - k*x)", "c*v - k*x*exp(1e4*max(gate, 0)))"))
    words = ["compare", SPEC, "--set", "train.0.epochs=1", "--jobs", "1", "--seeds", "4"]
    assert msnn(*words).code == 0
    latest = {line.key: line for line in read(Path("runs") / LOG)}
    assert next(line.state for line in latest.values()) == "diverged"
    ended = [line for line in latest.values() if line.state == "finished"]
    assert len(ended) > 1
    assert [line.seed for line in ended if line.cost is not None] == [ended[0].seed]


def test_equal_comparisons_at_once_share_their_trainings(msnn: CommandLine):
    """Each training is done once, by whichever comes first, and all say the same."""
    words = ("compare", SPEC, "--set", "train.0.epochs=30", "--seeds", "4", "--no-cost")
    jobs = ("1", "2", "1")
    began = [
        subprocess.Popen(
            [sys.executable, "-m", "msnn", *words, "--jobs", number],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for number in jobs
    ]
    said = [process.communicate() for process in began]
    assert [process.returncode for process in began] == [0, 0, 0], said
    assert len({_but_seconds(out) for out, _ in said}) == 1, said
    lines = read(Path("runs") / LOG)
    assert len(lines) == len({line.key for line in lines}) == 4
    folder = Path("runs/plant/compare")
    assert len(list(folder.iterdir())) == 4  # and no file of a lock
    for line in lines:
        assert not (Path("runs") / str(line.folder) / "checkpoint.safetensors").exists()


def test_a_comparison_takes_what_another_has_trained_since_it_began(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch
):
    words = ("compare", SPEC, "--set", "train.0.epochs=2", "--no-cost")
    assert msnn(*words).code == 0
    before = Path("runs", LOG).read_text()
    monkeypatch.setattr("msnn.features.comparison.compare.read", lambda log: [])
    said = msnn(*words)
    assert said.code == 0, said.err
    assert Path("runs", LOG).read_text() == before
