"""Starts mean the same in training, validation, simulation and reports."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn.api.shown_progress import Event
from msnn.data.dataset import FloatArray
from msnn.model.saved_run import WEIGHTS
from msnn.model.weights.kept_starts import STARTS
from msnn.training.records.progress import EpochEnd
from msnn.training.training_result import TrainingInterruptedError
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from tests.conditions import require_tool
from tests.training.oscillator import FITTED, records

LATE = """
msnn: 1
name: late
sample_time: 1 s
inputs: {u: {between: hold}}
targets: {y: {}}
parameters: {a: 0.99}
states: {x: {next: a * x, init: {fit: {over: 20}}}}
outputs: {y_hat: {expr: x * u, predicts: "y[t]"}}
train: [{rollout: record, epochs: 20, optimizer: {levenberg_marquardt: {}}}]
validate: [{of: y_hat, data: train, rollout: record}]
"""
OVER_RECORD = LATE.replace("over: 20", "over: record")
ADAM = "optimizer: {adam: {lr: 0.001}}"


def late(rows: int = 400, quiet: int = 50) -> dict[str, FloatArray]:
    """y = 2 · 0.999^t · u with noise of 0.01, of which the first rows tell nothing."""
    t = np.arange(rows)
    u = np.where(t < quiet, 0.0, np.sin(0.1 * t))
    y = 2 * 0.999**t * u + 0.01 * np.random.default_rng(2).normal(size=rows)
    return {"u": u, "y": y}


def model(text: str, folder: Path) -> msnn.Model:
    spec = folder / "late.msnn.yaml"
    spec.write_text(text.lstrip())
    return msnn.load(spec)


@pytest.mark.parametrize("text", [LATE, OVER_RECORD], ids=["20", "record"])
@pytest.mark.parametrize("kept", ["result", "folder"])
def test_validation_of_the_training_rows_gives_the_figure_of_the_training(
    text: str, kept: str, tmp_path: Path
) -> None:
    """Training reached 0.0102, validation of the same rows said 1.0956."""
    require_tool("gcc", install="apt install gcc")
    plant, data = model(text, tmp_path), late()
    found = msnn.train(plant, {"train": data}, runs=tmp_path / "runs")
    assert found.folder is not None
    weights = found if kept == "result" else found.folder / WEIGHTS
    (row,) = msnn.validate(plant, weights, {"train": data}).rows
    assert row.value**2 == pytest.approx(found.stages[-1].best_value, rel=1e-6)
    assert row.value == pytest.approx(0.01, rel=0.05)
    assert row.rows == "rows 0…399 of 400"
    assert "starts as trained" in row.details


ROBUST = OVER_RECORD.replace(
    "train: [", 'losses: {fit: "huber(y_hat, y, delta=0.02)"}\ntrain: ['
).replace("of: y_hat", "of: fit")


def outlying() -> dict[str, FloatArray]:
    """With rows that are far off on one side, which move the start by least squares."""
    data = late(360, quiet=10)
    data["y"][60::7] += 1.0
    return data


@pytest.mark.parametrize("rollout", ["record", "{horizon: 60, stride: 60}"])
@pytest.mark.parametrize("epochs", ["2", "40"])
def test_starts_of_a_robust_loss_are_kept_as_training_ended_with_them(
    rollout: str, epochs: str, tmp_path: Path
) -> None:
    """Those by least squares gave another figure, said to be of starts as trained."""
    require_tool("gcc", install="apt install gcc")
    text = ROBUST.replace("epochs: 20", f"epochs: {epochs}")
    text = text.replace("train: [{rollout: record", f"train: [{{rollout: {rollout}")
    check = rollout.replace(", stride: 60", "")
    text = text.replace("data: train, rollout: record", f"data: train, rollout: {check}")
    plant, data = model(text, tmp_path), {"train": outlying()}
    found = msnn.train(plant, data, runs=tmp_path / "runs")
    assert found.folder is not None
    (row,) = msnn.validate(plant, found.folder / WEIGHTS, data).rows
    assert row.value == pytest.approx(found.stages[-1].best_value, rel=1e-9)
    assert "starts as trained" in row.details


def test_rollouts_of_a_robust_loss_that_were_not_trained_on_are_not_said_to_start_as_trained(
    tmp_path: Path,
) -> None:
    """The rest of a record, of 10 rows, is no rollout to train on."""
    require_tool("gcc", install="apt install gcc")
    text = ROBUST.replace("[{rollout: record", "[{rollout: {horizon: 50, stride: 50}")
    plant = model(text.replace("train, rollout: record", "train, rollout: 50"), tmp_path)
    found = msnn.train(plant, {"train": outlying()}, runs=None)
    assert found.starts is not None
    assert found.starts.run[:, 1].tolist() == [*range(0, 350, 50)]
    (row,) = msnn.validate(plant, found, {"train": outlying()}).rows
    assert "starts as trained" not in row.details


def test_a_resumed_training_keeps_the_starts_of_one_that_was_not_interrupted(
    tmp_path: Path,
) -> None:
    """The first attempt is over, and keeps its starts, when the second one is interrupted."""
    require_tool("gcc", install="apt install gcc")
    plant = model(ROBUST.replace("epochs: 20", "epochs: 20, starts: 2"), tmp_path)
    data, runs = {"train": outlying()}, tmp_path / "runs"

    def interrupting(event: Event) -> None:
        if isinstance(event, EpochEnd) and (event.attempt, event.epoch) == (2, 1):
            os.kill(os.getpid(), signal.SIGINT)

    whole = msnn.train(plant, data, runs=None)
    with pytest.raises(TrainingInterruptedError):
        msnn.train(plant, data, runs=runs, progress=interrupting)
    found = msnn.train(plant, data, runs=runs, resume=True)
    assert whole.starts is not None
    assert found.starts is not None
    np.testing.assert_array_equal(found.starts.values["x"], whole.starts.values["x"])
    (row,) = msnn.validate(plant, found, data).rows
    assert row.value == pytest.approx(found.stages[-1].best_value, rel=1e-9)


@pytest.mark.parametrize("stage", [ADAM, "optimizer: {levenberg_marquardt: {}}"])
def test_a_whole_run_decides_its_start_in_training_and_in_validation(
    stage: str, tmp_path: Path
) -> None:
    """Of another recording too, where the row of results says that nothing is left out."""
    require_tool("gcc", install="apt install gcc")
    text = OVER_RECORD.replace("optimizer: {levenberg_marquardt: {}}", stage)
    plant = model(text.replace("epochs: 20", "epochs: 400"), tmp_path)
    found = msnn.train(plant, {"train": late()}, runs=None)
    other = {name: values[:300] for name, values in late().items()}
    (row,) = msnn.validate(plant, found, {"train": other}).rows
    assert row.value == pytest.approx(0.01, rel=0.1)
    assert "starts from all rows" in row.details
    assert row.scored == 300


def test_a_simulation_of_a_training_recording_starts_as_trained(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    plant, data = model(LATE, tmp_path), late()
    found = msnn.train(plant, {"train": data}, runs=None)
    assert found.starts is not None
    (start,) = found.starts.values["x"]
    assert start == pytest.approx(2.0, rel=0.01)
    (run,) = msnn.simulate(plant, data, found)
    t = np.arange(400)
    expected = start * float(found.weights["a"]) ** t * data["u"]
    np.testing.assert_allclose(run.outputs["y_hat"], expected, rtol=1e-9, atol=1e-12)


def test_a_start_that_only_later_rows_decide_is_refused(tmp_path: Path) -> None:
    """It stood at 0, and the figure was that of the guess."""
    require_tool("gcc", install="apt install gcc")
    plant = model(LATE, tmp_path)
    found = msnn.train(plant, {"train": late()}, runs=None)
    other = {"train": late(300)}
    for refused in (
        lambda: msnn.validate(plant, found, other),
        lambda: msnn.validate(plant, found.weights, {"train": late()}),
        lambda: msnn.simulate(plant, late(300), found),
        lambda: msnn.train(
            model(LATE.replace("optimizer: {levenberg_marquardt: {}}", ADAM), tmp_path),
            other,
            runs=None,
        ),
    ):
        with pytest.raises(SpecError, match="do not decide where `x` starts") as raised:
            refused()
        assert [one.code for one in raised.value.diagnostics] == ["E0874"]


def test_the_ways_out_of_a_refused_start_work(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    other = {"train": late(300)}
    for instead, expected in (
        ("over: record", 0.01),
        ("over: 80", 0.01),
        ('over: 20, from: "2"', 0.01),
    ):
        plant = model(LATE.replace("over: 20", instead), tmp_path)
        (row,) = msnn.validate(plant, {"a": np.array(0.999)}, other).rows
        assert row.value == pytest.approx(expected, rel=0.1)


def test_starts_of_other_weights_are_not_taken(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    plant, data = model(OVER_RECORD, tmp_path), {"train": late()}
    found = msnn.train(plant, data, runs=tmp_path / "runs")
    assert found.folder is not None
    again = {name: 0.999 * value for name, value in found.weights.items()}
    (row,) = msnn.validate(plant, again, data).rows
    assert "starts as trained" not in row.details
    # a damaged file is one that is not there
    kept = found.folder / STARTS
    kept.write_bytes(kept.read_bytes()[:-9])
    (row,) = msnn.validate(plant, found.folder / WEIGHTS, data).rows
    assert "starts as trained" not in row.details


def test_rows_that_were_held_out_of_a_recording_do_not_decide_its_start(tmp_path: Path) -> None:
    """The run through a recording starts where its training rows have put it."""
    require_tool("gcc", install="apt install gcc")
    data = late(quiet=0)
    # rows to test on that would move the start
    data["y"][300:] += 1.0
    table = np.stack([data["u"], data["y"]], axis=1)
    np.savetxt(tmp_path / "late.csv", table, "%.17g", ",", header="u,y", comments="")
    split = "data: {source: {files: late.csv}, split: {by: fraction, test: 0.25, val: 0}}\n"
    text = OVER_RECORD.replace("data: train,", "data: test,").replace(
        "train: [", f"{split}train: ["
    )
    plant = model(text, tmp_path)
    found = msnn.train(plant, runs=None)
    assert found.starts is not None
    assert found.starts.values["x"] == pytest.approx(2.0, rel=0.01)
    (row,) = msnn.validate(plant, found).rows
    assert "starts as trained" in row.details
    assert row.value == pytest.approx(1.0, rel=0.05)


def test_a_recording_of_another_set_does_not_start_as_trained(tmp_path: Path) -> None:
    """Runs through whole records go through those of other sets, and score nothing there."""
    require_tool("gcc", install="apt install gcc")
    text = LATE.replace("over: 20", "over: 80").replace("data: train,", "data: test,")
    plant = model(text, tmp_path)
    data = {"train": late(), "test": {name: values[:300] for name, values in late(quiet=0).items()}}
    found = msnn.train(plant, data, runs=None)
    assert found.starts is not None
    assert len(found.starts.run) == 1
    (row,) = msnn.validate(plant, found, data).rows
    assert "starts as trained" not in row.details
    assert (row.scored, row.value) == (220, pytest.approx(0.01, rel=0.1))


def test_short_rollouts_start_as_trained(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    stage = "rollout: {horizon: 60, stride: 60}, optimizer: {levenberg_marquardt: {}}"
    checks = "validate: [{of: y, data: train, rollout: {horizon: 60}}]"
    plant = model(f"{FITTED}train: [{{epochs: 8, {stage}}}]\n{checks}\n", tmp_path)
    data = {"train": [_of(records(1, 120, seed=6 + i)) for i in range(2)]}
    found = msnn.train(plant, data, runs=None)
    (row,) = msnn.validate(plant, found, data).rows
    assert row.value**2 == pytest.approx(found.stages[-1].best_value, rel=1e-6)
    assert row.scored == 240


@pytest.mark.parametrize("over", ["record", "20"])
def test_a_recording_that_is_not_trained_on_raises_no_doubt_about_training(
    over: str, tmp_path: Path
) -> None:
    """Runs through whole records go through it, and nothing there decides where they start."""
    require_tool("gcc", install="apt install gcc")
    text = OVER_RECORD.replace("over: record", f"over: {over}").replace(
        "optimizer: {levenberg_marquardt: {}}", ADAM
    )
    data = {"train": late(quiet=0), "test": late(300)}
    events: list[Event] = []
    plant = model(text, tmp_path)
    found = msnn.train(plant, data, runs=None, progress=events.append)
    assert not [one for one in events if isinstance(one, Diagnostic) and one.code == "W0807"]
    report = msnn.validate(plant, found, data)
    assert not report.warnings
    assert report.rows[0].scored == (400 if over == "record" else 380)
    # the starts of the other recording are not those of the training, and nothing is scored there
    assert ("starts as trained" in report.rows[0].details) == (over == "record")


def _of(series: dict[str, FloatArray]) -> dict[str, FloatArray]:
    return {name: series[name] for name in ("u", "q")}
