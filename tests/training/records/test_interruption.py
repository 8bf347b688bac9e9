"""Ctrl-C and SIGTERM leave a checkpoint; a resumed run ends with the bits of an undisturbed one."""

from __future__ import annotations

import os
import signal
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from msnn.model.weights.weights_file import read_weights
from msnn.training.records.progress import EpochEnd, Silent, epoch_text
from msnn.training.records.training_options import TrainingOptions
from msnn.training.stages import stage_run
from msnn.training.train import train
from msnn.training.training_result import (
    TrainingDivergedError,
    TrainingInterruptedError,
    TrainingResult,
)
from spec_schema.diagnostics.diagnostic import SpecError
from tests.training.cases import dataset, gain, gain_series

STAGES = {
    "adam": "  - {epochs: 6, batch: 16}\n  - {epochs: 5, batch: 8, rollout: 4}\n",
    "lessons": "  - {epochs: 6, batch: 16, rollout: {horizon: 5, curriculum: {2: 2, 4: 3}},"
    " optimizer: {sgd: {lr: 0.3}}, schedule: {plateau: {patience: 1, factor: 0.5}}}\n",
    "torch": "  - {epochs: 5, batch: 16, engine: torch, schedule: {cosine: {}}}\n",
    "lbfgs": "  - {epochs: 6, batch: 30, optimizer: {lbfgs: {iterations: 2}}}\n",
    "second_order": "  - {epochs: 6, rollout: 5, optimizer: {levenberg_marquardt: {damping: 9}}}\n",
}


class Interrupting(Silent):
    """Sends Ctrl-C to this process when an epoch of a stage ends."""

    def __init__(self, stage: str, epoch: int) -> None:
        self._at = (stage, epoch)

    def epoch_ended(self, event: EpochEnd) -> None:
        if (event.stage, event.epoch) == self._at:
            os.kill(os.getpid(), signal.SIGINT)


def run(stages: str, options: TrainingOptions, progress: Silent | None = None) -> TrainingResult:
    program, spec = gain(stages)
    data = dataset(gain_series(150), train=[70], val=[40])
    return train(program, data, spec.train, options, progress)


@pytest.mark.parametrize(
    ("kind", "stage", "epoch"),
    [
        ("adam", "stage_1", 3),
        ("adam", "stage_2", 2),
        ("lbfgs", "stage_1", 2),
        ("lessons", "stage_1", 3),
        ("lessons", "stage_1", 5),
        ("torch", "stage_1", 2),
        ("second_order", "stage_1", 3),
    ],
)
def test_resuming_continues_bit_for_bit(kind: str, stage: str, epoch: int, tmp_path: Path) -> None:
    undisturbed = run(STAGES[kind], TrainingOptions(runs=None))
    with pytest.raises(TrainingInterruptedError) as caught:
        run(STAGES[kind], TrainingOptions(runs=tmp_path), Interrupting(stage, epoch))
    folder = caught.value.result.folder
    assert folder is not None
    assert (folder / "checkpoint.safetensors").is_file()
    assert (folder / "weights.safetensors").is_file()
    assert (tmp_path / "gain" / "latest").resolve() == folder.resolve()
    resumed = run(STAGES[kind], TrainingOptions(runs=tmp_path, resume=True))
    assert resumed.folder == folder
    for name, value in undisturbed.weights.items():
        np.testing.assert_array_equal(resumed.weights[name], value)
    assert not (folder / "checkpoint.safetensors").exists()
    # one line an epoch, none twice
    epochs = (folder / "metrics.jsonl").read_text().count("\n")
    assert epochs == {"adam": 11, "lbfgs": 6, "lessons": 6, "torch": 5, "second_order": 6}[kind]


@pytest.mark.parametrize("stage", ["stage_1", "stage_2"])
def test_an_interrupted_run_has_the_best_weights_of_its_epochs(stage: str, tmp_path: Path) -> None:
    """Those of a training that ends after so many, not those with which the stage began."""
    whole = STAGES["adam"].splitlines(keepends=True)
    shorter = [line.replace("5", "2").replace("epochs: 6", "epochs: 3") for line in whole]
    stages = {"stage_1": shorter[0], "stage_2": whole[0] + shorter[1]}[stage]
    expected = run(stages, TrainingOptions(runs=None))
    assert expected.stages[-1].best_epoch > 0
    at = Interrupting(stage, {"stage_1": 3, "stage_2": 2}[stage])
    with pytest.raises(TrainingInterruptedError) as caught:
        run(STAGES["adam"], TrainingOptions(runs=tmp_path), at)
    found = caught.value.result
    assert found.folder is not None
    kept = read_weights(found.folder / "weights.safetensors", gain(stages)[0])
    for name, value in expected.weights.items():
        np.testing.assert_array_equal(found.weights[name], value)
        np.testing.assert_array_equal(kept[name], value)


def test_the_time_that_is_left_counts_all_epochs_of_a_resumed_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An epoch takes as long as those before the interruption, not the little time since it."""

    class Kept(Interrupting):
        def __init__(self, epoch: int) -> None:
            super().__init__("stage_1", epoch)
            self.events: list[EpochEnd] = []

        def epoch_ended(self, event: EpochEnd) -> None:
            self.events.append(event)
            super().epoch_ended(event)

    stages, ticks = "  - {epochs: 40, engine: torch, batch: 16}\n", count()
    # a hundredth of a second for each time that the stage asks
    clock = SimpleNamespace(monotonic=lambda: 0.01 * next(ticks))
    monkeypatch.setattr(stage_run, "time", clock)
    first, second = Kept(20), Kept(21)
    with pytest.raises(TrainingInterruptedError):
        run(stages, TrainingOptions(runs=tmp_path), first)
    with pytest.raises(TrainingInterruptedError):
        run(stages, TrainingOptions(runs=tmp_path, resume=True), second)
    before, (after,) = first.events[-1], second.events
    assert (before.epoch, after.epoch) == (20, 21)
    # the epoch after the interruption took about as long as each of the 20 before
    assert after.seconds / 21 == pytest.approx(before.seconds / 20, rel=0.1)
    left = after.seconds / 21 * 19
    assert f"{after.seconds:.1f} s, {left:.0f} s left" in epoch_text(after)


def test_the_second_interrupt_is_not_waited_for() -> None:
    class Twice(Silent):
        def epoch_ended(self, event: EpochEnd) -> None:
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run(STAGES["adam"], TrainingOptions(runs=None), Twice())
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_resumed_run_that_diverges_stays_the_latest(tmp_path: Path) -> None:
    """`latest` led to its weights after the interruption; those kept now are at least as good."""
    stages = "  - {epochs: 4, batch: 16}\n  - {epochs: 3, optimizer: {sgd: {lr: 1e30}}}\n"
    with pytest.raises(TrainingInterruptedError):
        run(stages, TrainingOptions(runs=tmp_path), Interrupting("stage_1", 3))
    with pytest.raises(TrainingDivergedError) as caught:
        run(stages, TrainingOptions(runs=tmp_path, resume=True))
    assert caught.value.is_latest
    folder = caught.value.result.folder
    assert folder is not None
    assert (tmp_path / "gain" / "latest").resolve() == folder.resolve()
    program, _ = gain(stages)
    kept = read_weights(folder / "weights.safetensors", program)
    assert kept["a"] == caught.value.result.weights["a"]
    assert np.isfinite(kept["a"])


def test_a_run_that_diverges_at_once_is_not_the_latest(tmp_path: Path) -> None:
    with pytest.raises(TrainingDivergedError) as caught:
        run("  - {optimizer: {sgd: {lr: 1e30}}}\n", TrainingOptions(runs=tmp_path))
    assert not caught.value.is_latest
    assert not (tmp_path / "gain" / "latest").exists()


@pytest.mark.parametrize(
    ("stages", "changed"),
    [
        (
            "  - {epochs: 7, batch: 16}\n  - {epochs: 5, batch: 8, rollout: 4}\n",
            "train.0.epochs: 6, now 7",
        ),
        (
            "  - {epochs: 6, batch: 16}\n  - {epochs: 5, batch: 8, rollout: 5}\n",
            "train.1.rollout.horizon: 4, now 5",
        ),
        ("  - {epochs: 6, batch: 16}\n", "train.1.epochs: 5, now not given"),
        (
            "  - {epochs: 6, batch: 16, clip: 1}\n  - {epochs: 5, batch: 8, rollout: 4}\n",
            "train.0.clip: not given, now 1.0",
        ),
    ],
)
def test_other_settings_than_those_of_the_run_are_named(
    stages: str, changed: str, tmp_path: Path
) -> None:
    with pytest.raises(TrainingInterruptedError):
        run(STAGES["adam"], TrainingOptions(runs=tmp_path), Interrupting("stage_1", 3))
    with pytest.raises(SpecError) as caught:
        run(stages, TrainingOptions(runs=tmp_path, resume=True))
    (found,) = caught.value.diagnostics
    assert found.code == "E0946"
    assert changed in found.notes


def test_other_data_than_those_of_the_run_are_named(tmp_path: Path) -> None:
    with pytest.raises(TrainingInterruptedError):
        run(STAGES["adam"], TrainingOptions(runs=tmp_path), Interrupting("stage_1", 3))
    program, spec = gain(STAGES["adam"])
    series = gain_series(150)
    series["u"][5] += 1e-12
    other = dataset(series, train=[70], val=[40])
    with pytest.raises(SpecError) as caught:
        train(program, other, spec.train, TrainingOptions(runs=tmp_path, resume=True))
    assert caught.value.diagnostics[0].notes == ("the data have changed",)


def test_other_threads_go_on(tmp_path: Path) -> None:
    with pytest.raises(TrainingInterruptedError):
        run("  - {epochs: 4}\n", TrainingOptions(runs=tmp_path), Interrupting("stage_1", 2))
    assert run("  - {epochs: 4, threads: 2}\n", TrainingOptions(runs=tmp_path, resume=True)).stages


def test_nothing_to_resume_is_said(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="no interrupted run"):
        run(STAGES["adam"], TrainingOptions(runs=tmp_path, resume=True))


@pytest.mark.parametrize("content", [b"", b"\x08\0\0\0\0\0\0\0{}      ", b"junk" * 100])
def test_a_damaged_checkpoint_is_refused(content: bytes, tmp_path: Path) -> None:
    with pytest.raises(TrainingInterruptedError) as caught:
        run(STAGES["adam"], TrainingOptions(runs=tmp_path), Interrupting("stage_1", 1))
    folder = caught.value.result.folder
    assert folder is not None
    (folder / "checkpoint.safetensors").write_bytes(content)
    with pytest.raises(SpecError, match="cannot resume"):
        run(STAGES["adam"], TrainingOptions(runs=tmp_path, resume=True))
