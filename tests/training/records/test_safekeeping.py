"""A killed training keeps its best weights and where it stood, and goes on bit for bit."""

from __future__ import annotations

import errno
import json
import os
import signal
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backends.files import atomic_write
from msnn.data.dataset import FloatArray
from msnn.model.weights.weights_file import read_weights
from msnn.training.records.checkpoint import Checkpoint, read_checkpoint
from msnn.training.records.progress import EpochEnd, Lines, Silent, StageStart
from msnn.training.records.resumable_run import NotedProgress, Safekeeping
from msnn.training.records.run_folder import METRICS, RunFolder, held
from msnn.training.records.training_options import TrainingOptions
from msnn.training.stages import stage_run
from msnn.training.stages.stage_run import Pace
from msnn.training.train import train
from msnn.training.training_result import TrainingInterruptedError, TrainingResult
from spec_schema.diagnostics.diagnostic import SpecError
from tests.full_disk import full_after
from tests.training.cases import dataset, gain, gain_series

STAGES = {
    "native": "  - {epochs: 4, batch: 8}\n  - {epochs: 4, batch: 8, rollout: 3, freeze: a}\n",
    "double": "  - {epochs: 3, batch: 8, dtype: float64}\n",
    "torch": "  - {epochs: 3, batch: 20, engine: torch}\n",
    "patience": "  - {batch: 16, optimizer: {sgd: {lr: 3}}, early_stop: {patience: 2}}\n",
    "second_order": "  - {epochs: 9, rollout: 5, optimizer: {levenberg_marquardt: {}}}\n",
    "attempts": "  - {epochs: 2, batch: 16, starts: 3}\n",
}


class Killed(BaseException):
    """Ends a training as SIGKILL does: nobody catches it."""


class Killing(Silent):
    """Kills at the end of an epoch."""

    def __init__(self, epoch: int) -> None:
        self._epoch = epoch

    def epoch_ended(self, event: EpochEnd) -> None:
        if event.epoch == self._epoch:
            raise Killed


def run(
    stages: str,
    runs: Path | None,
    progress: Silent | Lines | None = None,
    *,
    resume: bool = False,
    most_lost: float = 0.0,
) -> TrainingResult:
    program, spec = gain(stages)
    data = dataset(gain_series(150), train=[70], val=[40])
    options = TrainingOptions(runs=runs, resume=resume, most_lost=most_lost)
    return train(program, data, spec.train, options, progress)


def saves(monkeypatch: pytest.MonkeyPatch, kill_after: int | None = None) -> list[Checkpoint]:
    """The checkpoints that are written from now on; kills after so many."""
    save, written = Safekeeping.save, list[Checkpoint]()

    def saved(self: Safekeeping, now: Checkpoint, best: Mapping[str, FloatArray]) -> None:
        save(self, now, best)
        written.append(now)
        if len(written) == kill_after:
            raise Killed

    monkeypatch.setattr(Safekeeping, "save", saved)
    return written


@pytest.mark.parametrize("part", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("kind", STAGES)
def test_a_run_killed_at_any_checkpoint_goes_on_bit_for_bit(
    kind: str, part: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as counting:
        written = saves(counting)
        undisturbed = run(STAGES[kind], tmp_path / "undisturbed")
    with monkeypatch.context() as killing:
        saves(killing, kill_after=1 + round(part * (len(written) - 1)))
        with pytest.raises(Killed):
            run(STAGES[kind], tmp_path / "runs")
    assert not (tmp_path / "runs" / "gain" / "latest").is_symlink()
    resumed = run(STAGES[kind], tmp_path / "runs", resume=True)
    assert [(s.best_value, s.best_epoch, s.epochs, s.reason) for s in resumed.stages] == [
        (s.best_value, s.best_epoch, s.epochs, s.reason) for s in undisturbed.stages
    ]
    for name, value in undisturbed.weights.items():
        np.testing.assert_array_equal(resumed.weights[name], value)
    assert resumed.folder is not None
    assert undisturbed.folder is not None
    assert metrics(resumed.folder) == metrics(undisturbed.folder)
    assert sorted(p.name for p in resumed.folder.iterdir()) == sorted(
        p.name for p in undisturbed.folder.iterdir()
    )


def metrics(folder: Path) -> list[dict[str, object]]:
    """Every epoch but its time."""
    lines = (folder / METRICS).read_text().splitlines()
    return [{**json.loads(line), "seconds": None} for line in lines]


def test_a_killed_run_has_its_best_weights_and_no_epoch_twice(tmp_path: Path) -> None:
    with pytest.raises(Killed):
        run(STAGES["double"], tmp_path, Killing(3))
    (folder,) = (tmp_path / "gain").iterdir()
    epochs = [line["epoch"] for line in metrics(folder)]
    assert epochs == [1, 2, 3]  # written, and yet the checkpoint is older
    found = read_weights(folder / "weights.safetensors", gain()[0])
    assert found["a"] != 0.5
    with (folder / METRICS).open("a") as file:
        file.write('{"stage": "stage_1", "ep')  # a line that was cut
    (folder / ".weights.safetensors.1.part").write_bytes(b"half")
    run(STAGES["double"], tmp_path, resume=True)
    assert [line["epoch"] for line in metrics(folder)] == [1, 2, 3]
    assert not list(folder.glob(".*"))


@pytest.mark.parametrize("by", ["kill", "Ctrl-C"])
def test_weights_of_the_best_attempt_stay_while_a_worse_one_runs(by: str, tmp_path: Path) -> None:
    class Ending(Silent):
        def epoch_ended(self, event: EpochEnd) -> None:
            if (event.attempt, event.epoch) == (2, 2):
                if by == "kill":
                    raise Killed
                os.kill(os.getpid(), signal.SIGINT)

    def far(draw: int) -> Mapping[str, FloatArray]:
        return {"a": np.array(-9.0 * draw), "b": np.array(9.0)}

    program, spec = gain(STAGES["attempts"].replace("epochs: 2", "epochs: 3"))
    data = dataset(gain_series(150), train=[70], val=[40])
    options = TrainingOptions(runs=tmp_path, most_lost=0.0, redrawn=far)
    alone = run("  - {epochs: 3, batch: 16}\n", None)
    with pytest.raises((Killed, TrainingInterruptedError)):
        train(program, data, spec.train, options, Ending())
    (weights,) = tmp_path.rglob("2*/weights.safetensors")
    assert read_weights(weights, program) == alone.weights
    resumed = train(program, data, spec.train, replace(options, resume=True))
    assert resumed.weights == alone.weights
    assert resumed.stages[0].attempt == 0


def test_the_clock_decides_when_a_run_is_kept(tmp_path: Path) -> None:
    with pytest.raises(Killed):
        run(STAGES["double"], tmp_path, Killing(3), most_lost=1000.0)
    (folder,) = (tmp_path / "gain").iterdir()
    assert not (folder / "checkpoint.safetensors").exists()
    with pytest.raises(SpecError, match="no interrupted run"):
        run(STAGES["double"], tmp_path, resume=True)


def test_the_newest_run_with_a_checkpoint_goes_on(tmp_path: Path) -> None:
    for most_lost in (0.0, 0.0, 1000.0):
        with pytest.raises(Killed):
            run(STAGES["double"], tmp_path, Killing(2), most_lost=most_lost)
    folders = sorted((tmp_path / "gain").iterdir(), key=lambda path: path.stat().st_ctime_ns)
    created = sorted(folders, key=lambda path: (path / "run.json").stat().st_mtime_ns)
    assert run(STAGES["double"], tmp_path, resume=True).folder == created[1]


@pytest.mark.parametrize("kind", ["native", "double"])
def test_weights_and_losses_do_not_depend_on_the_calls_of_a_kernel(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock decides how many batches a call has; one by one and all at once are the same."""
    found: list[tuple[TrainingResult, list[dict[str, object]]]] = []
    for batches in (1, 3, 200):
        monkeypatch.setattr(Pace, "called", lambda self, *_: None)
        monkeypatch.setattr(Pace, "__init__", _fixed_pace(batches))
        result = run(STAGES[kind], tmp_path / str(batches), most_lost=5.0)
        assert result.folder is not None
        found.append((result, metrics(result.folder)))
    for result, epochs in found[1:]:
        assert epochs == found[0][1]
        for name, value in found[0][0].weights.items():
            np.testing.assert_array_equal(result.weights[name], value)


def _fixed_pace(batches: int) -> Callable[[Pace, int], None]:
    def init(self: Pace, most: int) -> None:
        self.most, self.seconds, self.batches = most, 0.0, min(batches, most)

    return init


def test_a_call_takes_a_part_of_a_second() -> None:
    pace = Pace(200)
    for expected in (2, 4, 8, 16, 32, 64, 128, 200, 200):
        pace.called(pace.batches, 1e-4 * pace.batches)
        assert pace.batches == expected
    pace.called(200, 10.0)  # 50 ms a batch
    assert pace.batches == 5
    pace.called(1, 30.0)
    assert pace.batches == 1


def test_is_due_before_work_that_takes_too_long() -> None:
    program, _ = gain()
    now = [0.0]
    folder = RunFolder(Path("nowhere"), program, None)
    safe = Safekeeping(folder, NotedProgress(Silent(), None), 5.0, now=lambda: now[0])
    now[0] = 4.0
    assert not safe.is_due(0.3)
    assert safe.is_due(0.6)  # half a second of the five is for writing
    assert not Safekeeping(None, NotedProgress(Silent(), None), 5.0).is_due(99.0)


def test_a_checkpoint_is_due_before_a_monitor_that_takes_too_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After the last batch of an epoch the monitor comes next, which takes as long as it took."""
    now, watch = [0.0], stage_run.monitor
    asked: list[float] = []

    def slow(*arguments: Any) -> float:
        now[0] += 3.0
        return watch(*arguments)

    def is_due(self: Safekeeping, ahead: float) -> bool:
        del self
        asked.append(ahead)
        return False

    monkeypatch.setattr(stage_run, "time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(stage_run, "monitor", slow)
    monkeypatch.setattr(Safekeeping, "is_due", is_due)
    run(STAGES["torch"], tmp_path)
    # 69 starts of one step: four batches an epoch, asked after each and after the monitor
    assert asked == [0.0, 0.0, 0.0, 3.0, 0.0] * 3


@pytest.mark.parametrize("call", [1, 4, 9, 12])
def test_a_full_disk_ends_a_training_with_the_name_of_the_file(
    call: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    undisturbed = run(STAGES["double"], None)
    fsync, calls = os.fsync, [0]

    def full(number: int) -> None:
        calls[0] += 1
        if calls[0] > 2 + call:  # after those of run.json
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(number)

    with monkeypatch.context() as disk:
        disk.setattr(atomic_write.os, "fsync", full)
        with pytest.raises(SpecError) as caught:
            run(STAGES["double"], tmp_path)
    (found,) = caught.value.diagnostics
    (folder,) = (tmp_path / "gain").iterdir()
    assert found.code == "E0927"
    assert f"cannot write {folder}{os.sep}" in found.message
    assert "no space left on device" in found.message
    assert not list(folder.glob(".*"))
    has_weights = (folder / "weights.safetensors").is_file()
    assert ("weights.safetensors" in found.notes[0]) == has_weights
    if (folder / "checkpoint.safetensors").is_file():
        assert read_weights(folder / "weights.safetensors", gain()[0])
        resumed = run(STAGES["double"], tmp_path, resume=True)
        assert resumed.weights == undisturbed.weights


@pytest.mark.parametrize("has_checkpoint", [False, True])
def test_epochs_that_a_full_disk_does_not_take_end_a_training_with_whole_lines(
    has_checkpoint: bool, tmp_path: Path
) -> None:
    many = "  - {epochs: 60, batch: 8}\n"  # more than other files of a run are long
    undisturbed = run(many, tmp_path / "before")
    assert undisturbed.folder is not None
    length = (undisturbed.folder / METRICS).stat().st_size
    room = length - 40  # the last line does not fit
    with full_after(room), pytest.raises(SpecError) as caught:
        run(many, tmp_path / "full", most_lost=0.0 if has_checkpoint else 1000.0)
    (found,) = caught.value.diagnostics
    (folder,) = (tmp_path / "full" / "gain").iterdir()
    assert f"cannot write {folder / METRICS}" in found.message
    assert metrics(folder) == metrics(undisturbed.folder)[:-1]
    assert ("`--resume`" in (found.help or "")) == has_checkpoint
    assert (folder / "checkpoint.safetensors").is_file() == has_checkpoint


def test_a_run_that_cannot_say_what_it_is_of_leaves_no_folder(tmp_path: Path) -> None:
    with full_after(100), pytest.raises(OSError, match=r"run\.json"):
        run(STAGES["native"], tmp_path)
    assert not list((tmp_path / "gain").iterdir())


@pytest.mark.parametrize("kind", ["file", "dead link"])
def test_what_stands_where_the_folder_of_runs_should_be_is_named(kind: str, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    if kind == "file":
        runs.write_text("notes")
    else:
        runs.symlink_to("nowhere")
    with pytest.raises(OSError, match="runs") as caught:
        run(STAGES["native"], runs)
    assert str(caught.value.filename).startswith(str(runs))


def test_the_time_that_is_left_counts_epochs_before_the_interruption(tmp_path: Path) -> None:
    """A resumed run is as fast as before: half of its epochs take as long as the first half."""

    class Heard(Silent):
        def __init__(self) -> None:
            self.began: list[int] = []
            self.seconds: list[float] = []

        def stage_started(self, event: StageStart) -> None:
            self.began.append(event.epoch)

        def epoch_ended(self, event: EpochEnd) -> None:
            self.seconds.append(event.seconds)

    with pytest.raises(Killed):
        run(STAGES["double"], tmp_path, Killing(2))
    (checkpoint,) = tmp_path.rglob("checkpoint.safetensors")
    kept = read_checkpoint(checkpoint)
    assert kept.place is not None
    heard = Heard()
    run(STAGES["double"], tmp_path, heard, resume=True)
    assert heard.began == [kept.place.epoch]
    assert heard.seconds[0] > kept.place.seconds


def test_a_run_that_another_process_trains_is_not_resumed(tmp_path: Path) -> None:
    with pytest.raises(Killed):
        run(STAGES["double"], tmp_path, Killing(2))
    (checkpoint,) = tmp_path.rglob("checkpoint.safetensors")
    # epochs since its last checkpoint, which a run that goes on takes away
    with (checkpoint.parent / "metrics.jsonl").open("a") as metrics:
        metrics.write('{"epoch": 9}\n')
    before = contents(checkpoint.parent)
    with held(checkpoint.parent), pytest.raises(SpecError) as caught:
        run(STAGES["double"], tmp_path, resume=True)
    assert [found.code for found in caught.value.diagnostics] == ["E0928"]
    assert contents(checkpoint.parent) == before
    assert run(STAGES["double"], tmp_path, resume=True).folder == checkpoint.parent


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
