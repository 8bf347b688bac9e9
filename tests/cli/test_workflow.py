"""The tour of a new user: init, check, train, validate, simulate, export, and calling the C."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from msnn.exports.table import NAMES
from msnn.project.new_project import DAMPING, MASS, STIFFNESS
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC, SUMMARY, change
from tests.conditions import require_tool

WEIGHTS = "runs/plant/latest/weights.safetensors"


@pytest.fixture(scope="module")
def trained_runs(made_project: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder `runs` after a training of the new project, as it is."""
    from msnn.api import models, trainings

    folder = tmp_path_factory.mktemp("trained")
    trainings.train(models.load(made_project / SPEC), runs=folder / "runs")
    return folder / "runs"


@pytest.fixture
def trained(project: Path, trained_runs: Path) -> Path:
    shutil.copytree(trained_runs, project / "runs", symlinks=True)
    return project


def test_init_makes_a_project_that_checks(msnn: CommandLine):
    said = msnn("init", "plant")
    assert (said.code, said.err) == (0, "")
    assert msnn("check", f"plant/{SPEC}").out == SUMMARY
    assert sorted(path.name for path in (msnn.folder).iterdir()) == ["plant"]


def test_init_makes_the_same_every_time(msnn: CommandLine):
    msnn("init", "one/plant")
    msnn("init", "two/plant")
    files = [p.relative_to("one") for p in Path("one").rglob("*") if p.is_file()]
    assert len(files) == 14
    assert all(Path("one", f).read_bytes() == Path("two", f).read_bytes() for f in files)


def test_init_overwrites_nothing(msnn: CommandLine):
    (msnn.folder / "plant").mkdir()
    said = msnn("init", "plant")
    assert said.code == 1
    assert "error[E1034]: plant is there already" in said.err
    assert list((msnn.folder / "plant").iterdir()) == []


@pytest.mark.parametrize("name", ["my-plant", "2plant", "t", "class", "a b", "plant.yaml", "_x"])
def test_init_wants_a_name_that_a_spec_can_have(msnn: CommandLine, name: str):
    said = msnn("init", name)
    assert said.code == 1
    assert f"error[E1035]: `{name}` cannot name a model" in said.err
    assert ("it is a reserved word" in said.err) == (name == "class")
    assert list(msnn.folder.iterdir()) == []


def test_training_prints_losses_and_parameters_with_units(msnn: CommandLine, project: Path):
    said = msnn("train", SPEC, "--set", "train.0.epochs=2")
    assert said.code == 0
    assert re.search(r"^stage +epochs +best total +at epoch +last x_next +ended$", said.out, re.M)
    assert re.search(r"^k +N/m +10 +\d", said.out, re.M)
    folder = re.search(r"^kept in (runs/plant/\S+)$", said.out, re.M)
    assert folder is not None
    assert (project / folder[1] / "weights.safetensors").is_file()
    assert (project / folder[1] / "spec.msnn.yaml").read_text() == (project / SPEC).read_text()
    assert "stage 1/1 fit: 2 epochs" in said.err


def test_a_folder_of_others_for_kernels_is_warned_of_once(
    msnn: CommandLine, project: Path, monkeypatch: pytest.MonkeyPatch
):
    require_tool("gcc", install="apt install gcc")
    shared, own = project / "shared", project / "own"
    shared.mkdir()
    shared.chmod(0o777)
    monkeypatch.setenv("MSNN_CACHE", str(shared))
    monkeypatch.setenv("XDG_CACHE_HOME", str(own))
    stage = "{epochs: 1}"
    said = msnn("train", SPEC, "--set", f"train=[{stage}, {stage}, {stage}]")
    warning = (
        f"warning[W1001]: no kernel is loaded from {shared}, since others may write to {shared}; "
        f"they are kept in {own}/msnn/kernels"
    )
    assert said.code == 0
    assert [line for line in said.err.splitlines() if "W1001" in line] == [warning]
    kept = json.loads((project / "runs/plant/latest/run.json").read_text())["end"]["warnings"]
    assert [line for line in kept if "W0937" not in line] == [warning]
    assert list(shared.iterdir()) == []


def test_training_as_json(msnn: CommandLine, project: Path):
    said = msnn("train", SPEC, "--set", "train.0.epochs=1", "--format", "json", "--engine", "torch")
    record = json.loads(said.out)
    assert (record["version"], record["command"]) == (1, "train")
    assert [stage["name"] for stage in record["stages"]] == ["fit"]
    assert {p["name"]: p["unit"] for p in record["parameters"]} == {
        "m": "kg",
        "c": "N*s/m",
        "k": "N/m",
    }


def test_training_finds_the_true_values(msnn: CommandLine, trained: Path):
    """2 %: three standard errors of these noisy records are below 0.5 %, the rest is Adam's."""
    from safetensors.numpy import load_file

    found = load_file(trained / WEIGHTS)
    for name, truth in (("m", MASS), ("c", DAMPING), ("k", STIFFNESS)):
        assert found[name] == pytest.approx(truth, rel=0.02)


def test_a_parameter_at_its_bound_is_reported(msnn: CommandLine, project: Path):
    change(project, "k: {init: 10,", "k: {init: 10, max: 10.001,")
    said = msnn("train", SPEC)
    assert said.code == 0
    # once, in full
    assert said.err.count("warning[W0904]: `k` ended at its bound") == 1
    assert "|" in said.err.partition("W0904")[2]
    assert re.search(r"^k +N/m +10 .* at its bound$", said.out, re.M)


def test_divergence_ends_with_4(msnn: CommandLine, project: Path):
    change(project, "a: (F - c*v - k*x) / m  ", "a: (F - c*v - k*x) / m + 1e9*exp(1e3*x*x)")
    said = msnn("train", SPEC)
    assert said.code == 4
    assert "error[E0913]: stage `fit` diverged" in said.err
    kept = re.search(r"^the best weights before are kept in (runs/plant/\S+);", said.err, re.M)
    assert kept is not None
    assert (project / kept[1] / "weights.safetensors").is_file()
    assert "error[E1036]" in msnn("validate", SPEC).err


def test_missing_data_ends_with_1(msnn: CommandLine, project: Path):
    shutil.rmtree(project / "data" / "test")
    said = msnn("train", SPEC)
    assert said.code == 1
    assert "error[E0801]: no data file matches `data/test/*.csv`" in said.err
    assert f"--> {SPEC}:31:43" in said.err
    assert not (project / "runs").exists()


def test_the_data_may_lie_elsewhere(msnn: CommandLine, project: Path, tmp_path: Path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (project / "data").rename(elsewhere / "data")
    assert msnn("validate", SPEC, "--initial").code == 1
    said = msnn("validate", SPEC, "--initial", "--data-root", elsewhere)
    assert said.code == 3


def test_untrained_models_say_what_to_do(msnn: CommandLine, project: Path):
    for verb in ("validate", "simulate", "export"):
        said = msnn(verb, SPEC)
        assert said.code == 1
        assert said.err == (
            f"error[E1036]: `plant` has no trained weights: there is no {WEIGHTS}\n"
            " = help: run `msnn train` first, or take the initial values with `--initial`\n"
        )
    assert not (project / "build").exists()


def test_validate_prints_rows_and_limits(msnn: CommandLine, trained: Path):
    said = msnn("validate", SPEC, "--junit", "out/junit.xml")
    assert said.code == 0
    assert re.search(r"^x_next +rmse +0\.001\d+ +m +≤ 0\.003 +kept +one step ", said.out, re.M)
    assert said.out.count("398 of 400 rows in 2 records") == 2
    suite = ElementTree.parse(trained / "out" / "junit.xml").getroot()  # noqa: S314  (our own file)
    assert (suite.get("tests"), suite.get("failures")) == ("2", "0")


def test_a_broken_limit_ends_with_3(msnn: CommandLine, trained: Path):
    said = msnn("validate", SPEC, "--set", "validate.0.max=1 um", "--junit", "junit.xml")
    assert said.code == 3
    assert "BROKEN" in said.out
    assert "error[E0870]: rmse of `x_next` is 0.001" in said.err
    assert "and the limit is ≤ 1e-06 m" in said.err
    assert f" --> {SPEC}:44:5" in said.err
    suite = ElementTree.parse(trained / "junit.xml").getroot()  # noqa: S314  (our own file)
    assert suite.get("failures") == "1"
    record = json.loads(msnn("validate", SPEC, "--format", "json").out)
    assert record["passed"] is True
    assert [metric["unit"] for metric in record["metrics"]] == ["m", "m"]


def test_simulating_given_files(msnn: CommandLine, trained: Path):
    file = "data/test/run_01.csv"
    said = msnn("simulate", SPEC, "--data", file, "--horizon", "50", "--out", "out/run.csv")
    assert (said.code, said.out) == (0, "out/run.csv: 1 run, 50 steps\n")
    lines = (trained / "out" / "run.csv").read_text().splitlines()
    assert lines[0] == "file,set,row,time,x_next,x_next.log"
    assert lines[1].startswith(f"{file},data,0,0.0,")
    assert len(lines) == 51


def test_an_export_of_what_another_model_learned_says_whose_weights_it_has(
    msnn: CommandLine, trained: Path
):
    part = f"{{spec: {SPEC}, weights: {WEIGHTS}, freeze: all}}"
    text = f"""
msnn: 1
name: watch
sample_time: 50 ms
use: {{plant: {part}}}
inputs: {{x: 1}}
outputs: {{x_now: x}}
"""
    (trained / "watch.msnn.yaml").write_text(text, encoding="utf-8")
    said = msnn("export", "watch.msnn.yaml", "--to", "c")
    assert f"weights: the initial values of the spec, of `plant` those in {WEIGHTS}\n" in said.err


def test_a_given_file_that_is_not_there_is_named(msnn: CommandLine, project: Path):
    said = msnn("simulate", SPEC, "--initial", "--data", "nope.csv", "--data", "no/*.csv")
    assert said.code == 1
    assert said.err == (
        "weights: the initial values of the spec\n"
        "error[E0801]: no data file matches `nope.csv`\n\n"
        "error[E0801]: no data file matches `no/*.csv`\n"
    )


def test_simulating_with_a_plot(msnn: CommandLine, trained: Path):
    said = msnn("simulate", SPEC, "--plot", "run.png")
    assert said.code == 0
    assert (trained / "run.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("file", "begins"), [("v.png", b"\x89PNG"), ("v.svg", b"<?xml")])
def test_validating_with_a_plot(file: str, begins: bytes, msnn: CommandLine, trained: Path):
    said = msnn("validate", SPEC, "--plot", file, "--format", "json")
    assert said.code == 0
    assert (trained / file).read_bytes().startswith(begins)
    one_step, record = json.loads(said.out)["outputs"]
    assert one_step["curve"] is None
    assert len(record["curve"]["rmse"]) == len(record["curve"]["first"]) == 19


def test_a_bad_horizon_is_a_usage_error(msnn: CommandLine, trained: Path):
    for horizon in ("0", "-1", "x", "1.5"):
        assert msnn("simulate", SPEC, f"--horizon={horizon}").code == 2


def test_export_writes_what_the_spec_asks_for(msnn: CommandLine, trained: Path):
    assert re.fullmatch(r"c: \d+ files in build/export/c\n", msnn("export", SPEC).out)
    assert [path.name for path in (trained / "build" / "export").iterdir()] == ["c"]


def test_every_target_agrees_with_the_interpreter(msnn: CommandLine, trained: Path):
    require_tool("gcc", install="apt install gcc")
    said = msnn("export", SPEC, "--to", "all", "--check", "--format", "json")
    assert said.code == 0, said.err
    record = json.loads(said.out)
    found = {row["target"]: row for row in record["agreement"]["targets"]}
    assert (
        set(found) == set(record["files"]) == set(NAMES) - {"mpc"}
    )  # the spec has no such section
    assert found["c"]["bits"] == 0
    assert all(row["agrees"] for row in found.values())
    assert not list((trained / "build").rglob("__pycache__"))


def test_what_an_older_export_left_does_not_matter(msnn: CommandLine, trained: Path):
    require_tool("gcc", install="apt install gcc")
    assert msnn("export", SPEC, "--to", "c").code == 0
    change(trained, "dtype: float32", "dtype: float64, prefix: other")
    said = msnn("export", SPEC, "--to", "c", "--check")
    assert said.code == 0, said.err
    assert re.search(r"^c +float64 +200 .* agrees$", said.out, re.M)


def test_a_wrong_cell_is_shown(msnn: CommandLine, trained: Path):
    file = trained / "data" / "test" / "run_02.csv"
    lines = file.read_text().splitlines()
    lines[7] = lines[7].replace(",", ",x", 1)
    file.write_text("\n".join(lines) + "\n")
    said = msnn("validate", SPEC)
    assert said.code == 1
    assert "is not a number (row 6 of data/test/run_02.csv)" in said.err
    assert "--> data/test/run_02.csv:8:" in said.err


def test_resuming_where_nothing_was_interrupted(msnn: CommandLine, trained: Path):
    said = msnn("train", SPEC, "--resume")
    assert said.code == 1
    assert "error[E0915]: no interrupted run to resume in runs/plant" in said.err


def test_calling_the_exported_c_from_a_program_of_ones_own(msnn: CommandLine, trained: Path):
    """The program and the commands are those of the README that `msnn init` wrote."""
    require_tool("gcc", install="apt install gcc")
    assert msnn("export", SPEC, "--to", "c").code == 0
    readme = (trained / "README.md").read_text()
    program = re.search(r"```c\n(.*?)```", readme, re.S)
    build = re.search(r"^gcc .*$", readme, re.M)
    assert program is not None
    assert build is not None
    (trained / "main.c").write_text(program[1])
    subprocess.run(["bash", "-c", f"{build[0]} -Wall -Wextra -Werror"], cwd=trained, check=True)
    done = subprocess.run([trained / "main"], capture_output=True, text=True, check=True)
    last = done.stdout.splitlines()[-1].split()
    # after 1 s of 1 N: the step response of the true plant, within the error of the learned values
    assert last[0] == "1.00"
    assert float(last[2]) == pytest.approx(step_response(1.0), abs=1e-3)


def step_response(time: float) -> float:
    """x(t) of m·x″ + c·x′ + k·x = 1 from rest, underdamped."""
    import math

    decay = DAMPING / (2 * MASS)
    speed = math.sqrt(STIFFNESS / MASS - decay**2)
    swing = math.cos(speed * time) + decay / speed * math.sin(speed * time)
    return (1 - math.exp(-decay * time) * swing) / STIFFNESS


@pytest.mark.parametrize(
    "text", ["time,F,x,v\n0.00,\x1b[31m1,0,0\n", "time,F,\x1b[31mx,v\n0.00,1,0,0\n"]
)
def test_data_cannot_steer_the_terminal(msnn: CommandLine, project: Path, text: str):
    (project / "data" / "test" / "run_01.csv").write_text(text)
    said = msnn("validate", SPEC, "--initial")
    assert said.code == 1
    assert "\x1b" not in said.err
    assert "�[31m" in said.err


def test_a_simulation_among_the_training_data_is_named_as_one(msnn: CommandLine, project: Path):
    table = "data/train/run_99.csv"
    assert msnn("simulate", SPEC, "--initial", "-o", table).code == 0
    said = msnn("data", SPEC)
    assert said.code == 1
    assert "error[E0804]" in said.err
    assert "this is a table that `msnn simulate` has written" in said.err
    assert "write the next one there by `--out`" in said.err
    # as it is advised
    Path(table).rename("run_99.csv")
    assert msnn("data", SPEC).code == 0
    assert msnn("simulate", SPEC, "--initial", "--out", "run_99.csv").code == 0
    assert msnn("data", SPEC).code == 0
