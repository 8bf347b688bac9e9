"""Sweeps: what is drawn, that they are comparisons, and what is said of mistakes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import msnn as api
from backends.files import atomic_write
from msnn.features.comparison.variants import Draws, draw_axes
from msnn.project.new_project import new_project
from msnn.training.records.resumable_run import Safekeeping
from msnn.training.records.run_log import LOG, read
from spec_schema.diagnostics.diagnostic import SpecError
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC

SHORT = ("--set", "train.0.epochs=2", "--jobs", "1")
STIFFNESS = ("--draw", "parameters.k.init=log(5, 20) N/m")


@pytest.fixture
def msnn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> CommandLine:
    """The command line in a fresh project."""
    folder = new_project(tmp_path / "plant")
    monkeypatch.chdir(folder)
    return CommandLine(folder, capsys)


def drawn(law: str, count: int = 400, seed: int = 0) -> list[str]:
    found = Draws(draw_axes([f"a.b={law}"]), count, seed).drawn
    assert found is not None
    return [value for (value,) in found.rows]


def test_numbers_are_drawn_between_their_bounds_by_their_law():
    even = np.array([float(each) for each in drawn("uniform(2, 4)")])
    assert even.min() >= 2
    assert even.max() <= 4
    # four deviations of the mean of 400 draws: 2/√12/20
    assert abs(even.mean() - 3) < 4 * 2 / 12**0.5 / 20
    logs = np.log10([float(each) for each in drawn("log(1e-3, 1e1)")])
    assert abs(logs.mean() + 1) < 4 * 4 / 12**0.5 / 20
    assert set(drawn("integer(-1, 2)")) == {"-1", "0", "1", "2"}
    assert set(drawn("choice([1, 2], {a: 3})")) == {"[1, 2]", "{a: 3}"}
    assert all(each.endswith(" N/m") for each in drawn("log(1, 100) N/m"))
    assert set(drawn("uniform(1, 1.0000001)")) == {"1.0"}  # six digits, and no bound left behind


def test_more_draws_and_other_keys_leave_those_before():
    assert drawn("uniform(0, 1)", 5) == drawn("uniform(0, 1)", 9)[:5]
    assert drawn("uniform(0, 1)", 5) != drawn("uniform(0, 1)", 5, seed=1)
    both = Draws(draw_axes({"c": "integer(1, 9)", "a.b": "uniform(0, 1)"}), 5).drawn
    assert both is not None
    assert [row[1] for row in both.rows] == drawn("uniform(0, 1)", 5)


@pytest.mark.parametrize(
    ("law", "code"),
    [
        ("", "E0860"),
        ("a.b", "E0860"),
        ("=uniform(0, 1)", "E0860"),
        ("a.b=normal(0, 1)", "E0860"),
        ("a.b=uniform(0, 1", "E0860"),
        ("a.b=uniform(0, one)", "E0860"),
        ("a.b=uniform(0)", "E0860"),
        ("a.b=uniform(0, 1, 2)", "E0860"),
        ("a.b=choice()", "E0860"),
        ("a.b=choice(1, 2) N", "E0860"),
        ("a.b=uniform(1, 1)", "E0861"),
        ("a.b=uniform(0, .inf)", "E0860"),
        ("a.b=uniform(0, inf)", "E0861"),
        ("a.b=log(0, 1)", "E0861"),
        ("a.b=integer(0.5, 3)", "E0861"),
        ("a.b=integer(-1e308, 1e308)", "E0861"),
        ("a.b=uniform(-1e308, 1e308)", "E0861"),
        ("a.b=log(1e-200, 1e200)", "E0861"),
    ],
)
def test_what_nothing_can_be_drawn_from_is_refused(law: str, code: str):
    with pytest.raises(SpecError) as caught:
        draw_axes([law])
    assert [found.code for found in caught.value.diagnostics] == [code]


def test_draws_cross_the_grid_and_the_log_has_their_seed(msnn: CommandLine):
    asked = (*STIFFNESS, "--draws", "2", "--grid", "integrator=rk4,euler", "--draw-seed", "7")
    said = msnn("sweep", SPEC, *asked, *SHORT, "--format", "json")
    assert said.code == 0, said.err
    found = json.loads(said.out)
    assert found["draws"] == {
        "seed": 7,
        "count": 2,
        "keys": {"parameters.k.init": "log(5, 20) N/m"},
    }
    lines = read(Path("runs") / LOG)
    assert [line.drawn_by for line in lines] == [7] * 4
    assert [line.settings[-1] for line in lines] == ["integrator=rk4", "integrator=euler"] * 2
    assert len({line.settings[-2] for line in lines}) == 2


def test_a_larger_sweep_trains_what_is_new_and_compare_knows_it(msnn: CommandLine):
    assert msnn("sweep", SPEC, *STIFFNESS, "--draws", "1", *SHORT).code == 0
    assert msnn("sweep", SPEC, *STIFFNESS, "--draws", "3", *SHORT).code == 0
    lines = read(Path("runs") / LOG)
    assert len(lines) == 3
    value = lines[2].settings[-1].partition("=")[2]
    again = msnn("compare", SPEC, "--grid", f"parameters.k.init={value}", "--no-cost", *SHORT)
    assert again.err.count("trained before") == 1


def test_mistakes_end_a_sweep_before_any_training(msnn: CommandLine):
    for wrong, code in (
        (("--draw", "train.0.epoch=integer(1, 2)"), "E0201"),
        (("--draw", "train.0.epochs=choice(1, two)"), "E0204"),
        (("--draw", "train.0.epochs=gauss(1, 2)"), "E0860"),
        (("--draw", "train.0.epochs=integer(2, 1)"), "E0861"),
        (("--draw", "sample_time=choice(1)", "--grid", "sample_time=1"), "E0862"),
        (("--draws", "3"), "E0863"),
        (("--set", "parameters.k.init=3 N/m", *STIFFNESS), "E0857"),
        (("--set", "data.split.train=0.5", "--draw", "data.split=choice({by: fraction})"), "E0857"),
        (("--draw", "data.split.k=choice(2)", "--grid", "data.split={by: kfold}"), "E0862"),
    ):
        said = msnn("sweep", SPEC, *wrong, *SHORT[2:])
        assert said.code == 1
        assert f"error[{code}]" in said.err
        assert not Path("runs").exists()


def test_a_training_of_a_sweep_waits_for_the_disk_once(
    msnn: CommandLine, monkeypatch: pytest.MonkeyPatch
):
    """What a cut of power takes is trained again, so what is in weights must be whole, no more."""
    waited: list[str] = []
    own = atomic_write.sync

    def sync(path: Path) -> None:
        waited.append("a folder" if path.is_dir() else path.name.split(".")[1])
        own(path)

    monkeypatch.setattr(atomic_write, "sync", sync)
    # a machine with other work to do may take as long as trainings that write checkpoints
    monkeypatch.setattr(Safekeeping, "is_stale", False)
    monkeypatch.setattr(Safekeeping, "is_due", lambda *_: False)
    assert msnn("sweep", SPEC, *STIFFNESS, "--draws", "2", *SHORT).code == 0
    assert waited == ["weights", "weights"]


def test_a_sweep_in_python_shows_the_best(msnn: CommandLine):
    found = api.sweep(
        SPEC, draw={"parameters.k.init": "uniform(5, 20) N/m"}, draws=2, settings=SHORT[1:2]
    )
    assert found.best is not None
    assert len(found.entries) == 2
    assert found.draws.count == 2
