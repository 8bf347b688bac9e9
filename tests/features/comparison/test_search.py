"""Sweeps whose values Optuna proposes: a study, resumed, and what is said of mistakes."""

from __future__ import annotations

import json
import signal
import sqlite3
from collections.abc import Generator
from contextlib import closing
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import msnn as api
from msnn.features.comparison.proposals import Proposals
from msnn.features.comparison.trial import Trial
from msnn.packages import OptionalPackage
from msnn.project.new_project import new_project
from msnn.training.records.run_log import LOG, RunLine, read
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC
from tests.conditions import require_package

SHORT = ("--set", "train.0.epochs=2", "--jobs", "1")
STIFFNESS = "parameters.k.init=log(5, 20) N/m"


@pytest.fixture
def msnn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> CommandLine:
    """The command line in a fresh project."""
    folder = new_project(tmp_path / "plant")
    monkeypatch.chdir(folder)
    return CommandLine(folder, capsys)


def study(file: str) -> Any:
    """The only study of a file."""
    optuna = import_module("optuna")
    (found,) = optuna.get_all_study_summaries(f"sqlite:///{file}")
    return optuna.load_study(study_name=found.study_name, storage=f"sqlite:///{file}")


def test_a_study_holds_every_proposal_once_and_a_larger_search_goes_on(msnn: CommandLine):
    require_package("optuna", install="pip install 'msnn[optuna]'")
    asked = ("sweep", SPEC, "--optuna", "s/study.db", "--draw", STIFFNESS, "--seeds", "2", *SHORT)
    said = msnn(*asked, "--draws", "3", "--format", "json")
    assert said.code == 0, said.err
    found = json.loads(said.out)
    trials = study("s/study.db").trials
    assert [trial.state.name for trial in trials] == ["COMPLETE"] * 3
    scores = {model["settings"][-1]: model["score"] for model in found["models"]}
    for trial in trials:
        (value,) = trial.user_attrs["values"]
        assert value.endswith(" N/m")
        assert abs(float(value.split()[0]) / trial.params["parameters.k.init"] - 1) < 1e-5
        assert trial.value == scores[f"parameters.k.init={value}"]  # the mean of both seeds
    assert len(read(Path("runs") / LOG)) == 6

    again = msnn(*asked, "--draws", "4", "--format", "json")
    assert again.code == 0, again.err
    assert len(study("s/study.db").trials) == 4
    assert len(json.loads(again.out)["models"]) == 4
    assert len(read(Path("runs") / LOG)) == 8


def test_what_was_proposed_before_a_search_was_killed_is_told(msnn: CommandLine):
    """A proposal without a value is trained and told, one without values is given up."""
    require_package("optuna", install="pip install 'msnn[optuna]'")
    asked = ("sweep", SPEC, "--optuna", "study.db", "--draw", STIFFNESS, *SHORT)
    assert msnn(*asked, "--draws", "1").code == 0
    begun = study("study.db")
    law = import_module("optuna").distributions.FloatDistribution(5, 20, log=True)
    begun.ask({"parameters.k.init": law}).set_user_attr("values", ["7.0 N/m"])
    begun.ask({"parameters.k.init": law})
    assert msnn(*asked, "--draws", "4").code == 0
    states = [trial.state.name for trial in study("study.db").trials]
    assert states == ["COMPLETE", "COMPLETE", "FAIL", "COMPLETE", "COMPLETE"]
    settings = [line.settings[-1] for line in read(Path("runs") / LOG)]
    assert len(settings) == 4
    assert settings[1] == "parameters.k.init=7 N/m"


def test_a_value_that_another_command_has_told_stays(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch
):
    """Two commands with one study: the second trains what the first has asked, and tells it."""
    require_package("optuna", install="pip install 'msnn[optuna]'")
    ended = Proposals.ended

    def ended_later(self: Proposals, trial: Trial, line: RunLine) -> None:
        other = study("study.db")
        for each in other.get_trials(deepcopy=False):
            if not each.state.is_finished():
                other.tell(each.number, 0.25)
        ended(self, trial, line)

    monkeypatch.setattr(Proposals, "ended", ended_later)
    asked = ("sweep", SPEC, "--optuna", "study.db", "--draw", STIFFNESS, *SHORT)
    said = msnn(*asked, "--draws", "2")
    assert said.code == 0, said.err
    assert [trial.value for trial in study("study.db").trials] == [0.25, 0.25]
    assert len(read(Path("runs") / LOG)) == 2


@pytest.mark.parametrize("failing", ["ended", "more"])
def test_a_storage_that_fails_in_the_middle_ends_the_search_with_a_message(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch, failing: str
):
    """What was trained until then is in the log: the same command goes on with another file."""
    require_package("optuna", install="pip install 'msnn[optuna]'")
    whole = getattr(Proposals, failing)

    def failed(self: Proposals, *given: object) -> object:
        if Path("runs", LOG).is_file():
            with closing(sqlite3.connect("study.db")) as file:
                file.execute("DROP TABLE trials")
        return whole(self, *given)

    asked = ("sweep", SPEC, "--draw", STIFFNESS, "--draws", "2", *SHORT)
    with monkeypatch.context() as broken:
        broken.setattr(Proposals, failing, failed)
        said = msnn(*asked, "--optuna", "study.db")
    assert said.code == 1
    assert "error[E0858]" in said.err
    assert "study.db" in said.err
    assert len(read(Path("runs") / LOG)) == 1
    assert msnn(*asked, "--optuna", "other.db").code == 0
    assert len(read(Path("runs") / LOG)) == 2


@pytest.mark.parametrize(
    "ours",
    [
        "msnn.features.comparison.proposals._text",
        "msnn.features.comparison.proposals._score",
        "msnn.features.comparison.proposals.Proposals._law",
        "msnn.features.comparison.proposals.Proposals._variant",
    ],
)
def test_a_mistake_of_ours_is_not_told_as_one_of_the_storage(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch, ours: str
):
    """Each stands beside a call of Optuna, of which whatever it raises is the storage's."""
    require_package("optuna", install="pip install 'msnn[optuna]'")

    def broken(*arguments: object) -> None:
        raise ZeroDivisionError("ours")

    monkeypatch.setattr(ours, broken)
    said = msnn("sweep", SPEC, "--optuna", "s.db", "--draw", STIFFNESS, "--draws", "1", *SHORT)
    assert said.code == 70
    assert "ZeroDivisionError" in said.err
    assert "E0858" not in said.err


def test_a_proposal_that_diverges_has_failed_and_one_that_comes_twice_is_trained_once(
    msnn: CommandLine,
):
    require_package("optuna", install="pip install 'msnn[optuna]'")
    law = "choice(1, 2)"
    found = api.sweep(
        SPEC, draw={"train.0.epochs": law}, draws=5, optuna="study.db", by="rmse", jobs=2
    )
    assert len(found.entries) <= 2
    trials = study("study.db").trials
    assert [trial.state.name for trial in trials] == ["COMPLETE"] * 5
    assert len(read(Path("runs") / LOG)) == len(found.entries)

    law = "train.0.optimizer=choice({adam: {lr: 1.0e38}})"
    said = msnn("sweep", SPEC, "--optuna", "bad.db", "--draw", law, "--draws", "1", *SHORT)
    assert said.code == 4, said.err
    assert [trial.state.name for trial in study("bad.db").trials] == ["FAIL"]


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        (("--optuna", "study.db"), "E0854"),
        (("--optuna", "s.db", "--draw", STIFFNESS, "--grid", "integrator=rk4,euler"), "E0855"),
        (("--optuna", SPEC, "--draw", STIFFNESS), "E0856"),
        (("--optuna", "", "--draw", STIFFNESS), "E0859"),
        (("--optuna", "sqlite:///:memory:", "--draw", STIFFNESS), "E0859"),
        (("--optuna", "nothing://here", "--draw", STIFFNESS), "E0856"),
        (("--draw", STIFFNESS, "--set", "parameters.k.init=3 N/m"), "E0857"),
        (("--grid", "train.0={epochs: 1}", "--set", "train.0.epochs=3"), "E0857"),
        (("--grid", '"train.0.epochs"=1,2', "--set", "train.0.epochs=3"), "E0857"),
        (("--grid", "train.00.epochs=1,2", "--set", "train.0.epochs=3"), "E1032"),
        (("--grid", "train.0.epochs=1,2", "--draw", "train.00.epochs=integer(1, 9)"), "E1032"),
    ],
)
def test_mistakes_end_a_search_before_any_training(
    msnn: CommandLine, asked: tuple[str, ...], code: str
):
    require_package("optuna", install="pip install 'msnn[optuna]'")
    said = msnn("sweep", SPEC, *asked)
    assert said.code == 1
    assert f"error[{code}]" in said.err
    assert not Path("runs").exists()


def test_without_the_extra_the_line_that_installs_it_is_told(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch
):
    def missing(package: OptionalPackage) -> bool:
        return package.name != "optuna"

    monkeypatch.setattr(OptionalPackage, "is_installed", property(missing))
    said = msnn("sweep", SPEC, "--optuna", "study.db", "--draw", STIFFNESS)
    assert said.code == 5
    assert "optuna" in said.err
    assert "pip install" in said.err
    assert not Path("runs").exists()


@pytest.fixture
def own_signals() -> Generator[None]:
    """A rank ignores SIGTERM from its start on; other tests' processes must not inherit that."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.usefixtures("own_signals")
@pytest.mark.parametrize("verb", ["sweep", "compare"])
def test_torchrun_starts_no_comparison(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch, verb: str
):
    for name, value in (("TORCHELASTIC_RUN_ID", "1"), ("WORLD_SIZE", "2"), ("RANK", "0")):
        monkeypatch.setenv(name, value)
    said = msnn(verb, SPEC, "--grid", "train.0.epochs=1,2")
    assert said.code == 1
    assert "error[E0868]" in said.err
    assert not Path("runs").exists()
