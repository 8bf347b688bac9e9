"""Training every fold: what is held out, what is kept, and what the table says."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn.model.model import Model
from msnn.training.folds import FoldsResult, folds_table, of_fold
from msnn.training.records.progress import EpochEnd, Silent, StageEnd, StageStart
from msnn.training.records.run_folder import RunFolder
from msnn.training.training_result import TrainingDivergedError, TrainingInterruptedError
from spec_schema.diagnostics.diagnostic import Diagnostic
from tests.training.cases import GAIN, gain_series

FRAME = gain_series(30) | {"x": gain_series(30)["x"] + np.linspace(0, 0.3, 30) ** 2}
"""Of no exact gain, so that the folds differ."""
STAGE = "train: [{name: fit, epochs: 3, optimizer: {adam: {lr: 0.1}}, engine: torch}]\n"
KFOLD = "data: {source: {train: no.csv}, split: {by: kfold, k: 3}}\n"


def model(tmp_path: Path, more: str = STAGE + KFOLD) -> Model:
    file = tmp_path / "gain.msnn.yaml"
    file.write_text(GAIN + more)
    return msnn.load(file)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> FoldsResult:
    folder = tmp_path_factory.mktemp("folds")
    return msnn.train_folds(model(folder), FRAME, runs=folder / "runs")


def test_each_fold_is_a_training_of_its_own(kept: FoldsResult, tmp_path: Path) -> None:
    plain = model(tmp_path)
    for fold in kept.folds:
        alone = msnn.train(of_fold(plain, fold.number), FRAME, runs=None)
        assert alone.weights == fold.training.weights
        assert alone.stages[-1].best_value == fold.monitor
    assert len({fold.monitor for fold in kept.folds}) == 3


def test_metrics_are_those_of_the_rows_held_out(kept: FoldsResult) -> None:
    """Row t predicts x[t+1]: the last row of a fold has its target in the next one."""
    x, u = FRAME["x"], FRAME["u"]
    for fold in kept.folds:
        (row,) = fold.report.rows
        first = 10 * (fold.number - 1)
        t = np.arange(first, first + 9)
        found = fold.training.weights["a"] * x[t] + fold.training.weights["b"] * u[t]
        assert row.value == pytest.approx(np.sqrt(np.mean((found - x[t + 1]) ** 2)))


def test_entries_of_other_sets_are_measured_on_the_fold_too(tmp_path: Path) -> None:
    checks = "validate: [{of: x_next, data: train, max: 1e-9}]\n"
    found = msnn.train_folds(model(tmp_path, STAGE + KFOLD + checks), FRAME, runs=None)
    assert [fold.report.rows[0].data for fold in found.folds] == ["val"] * 3
    assert found.folder is None


def test_the_folder_of_folds(kept: FoldsResult) -> None:
    assert kept.folder is not None
    folders = [f"fold_{number}" for number in (1, 2, 3)]
    assert sorted(path.name for path in kept.folder.iterdir()) == [*folders, "folds.json"]
    latest = kept.folder.parent / "latest"
    assert latest.readlink() == Path(kept.folder.name, f"fold_{kept.best.number}")
    assert (latest / "weights.safetensors").is_file()
    assert kept.best.monitor == min(fold.monitor for fold in kept.folds)
    record = json.loads((kept.folder / "folds.json").read_text())
    assert record["best"] == kept.best.number
    monitors = [fold.monitor for fold in kept.folds]
    assert [fold["monitor"] for fold in record["folds"]] == monitors
    monitor, metric = record["summary"]
    assert monitor["mean"] == pytest.approx(sum(monitors) / 3)
    assert monitor["std"] == pytest.approx(np.std(monitors) * np.sqrt(3 / 2))
    assert metric["of"] == "x_next rmse [m], one step"


def test_the_table_has_a_row_a_fold_and_the_mean(kept: FoldsResult) -> None:
    header, *rows, last = folds_table(kept).splitlines()
    assert header.split()[:2] == ["fold", "monitor"]
    assert [row.split()[0] for row in rows] == ["1", "2", "3"]
    assert last.startswith("mean ± std")
    assert last.count("±") == 3


class Heard(Silent):
    """Keeps names of stages and warnings; sends Ctrl-C in the second fold if it is to."""

    def __init__(self, *, interrupt: bool = False) -> None:
        self.names: list[str] = []
        self.warnings: list[Diagnostic] = []
        self.interrupt = interrupt

    def stage_started(self, event: StageStart) -> None:
        self.names.append(event.name)

    def epoch_ended(self, event: EpochEnd) -> None:
        if self.interrupt and "fold 2" in event.stage:
            os.kill(os.getpid(), signal.SIGINT)

    def stage_ended(self, event: StageEnd) -> None:
        self.names.append(event.stage)

    def warned(self, diagnostic: Diagnostic) -> None:
        self.warnings.append(diagnostic)


def test_progress_names_the_fold_and_says_a_warning_once(tmp_path: Path) -> None:
    ranged = GAIN.replace("u: m}", "u: {unit: m, range: [0, 0.5]}}")
    file = tmp_path / "gain.msnn.yaml"
    file.write_text(ranged + STAGE + KFOLD)
    heard = Heard()
    msnn.train_folds(msnn.load(file), FRAME, runs=None, progress=heard)
    assert heard.names == [f"fit of fold {n}/3" for n in (1, 1, 2, 2, 3, 3)]
    assert len(heard.warnings) == 1


def test_a_fold_that_diverges_leaves_latest_alone(tmp_path: Path) -> None:
    frame = {**FRAME, "x": FRAME["x"].copy()}
    frame["x"][25] = 1e200  # in fold 3, which the first training reads
    with pytest.raises(TrainingDivergedError) as caught:
        msnn.train_folds(model(tmp_path), frame, runs=tmp_path / "runs")
    folder = caught.value.result.folder
    assert folder is not None
    assert (folder.name, caught.value.is_latest) == ("fold_1", False)
    assert not (tmp_path / "runs" / "gain" / "latest").is_symlink()


def test_an_interrupted_training_of_folds_goes_on_bit_for_bit(
    tmp_path: Path, kept: FoldsResult
) -> None:
    runs = tmp_path / "runs"
    with pytest.raises(TrainingInterruptedError) as caught:
        msnn.train_folds(model(tmp_path), FRAME, runs=runs, progress=Heard(interrupt=True))
    folder = caught.value.result.folder
    assert folder is not None
    assert folder.name == "fold_2"
    assert (folder.parent / "fold_1" / "weights.safetensors").is_file()
    record = json.loads((folder.parent / "folds.json").read_text())
    assert (record["of"], [fold["fold"] for fold in record["folds"]]) == (3, [1])
    assert not (runs / "gain" / "latest").is_symlink()
    resumed = msnn.train_folds(model(tmp_path), FRAME, runs=runs, resume=True)
    assert resumed.folder == folder.parent
    for fold, undisturbed in zip(resumed.folds, kept.folds, strict=True):
        assert fold.training.weights == undisturbed.training.weights
        assert fold.monitor == undisturbed.monitor
        assert [row.value for row in fold.report.rows] == [
            row.value for row in undisturbed.report.rows
        ]
    assert not list(runs.rglob("checkpoint.safetensors"))
    assert (runs / "gain" / "latest").resolve().name == f"fold_{resumed.best.number}"


def test_folds_that_are_all_over_go_on_until_latest_leads_to_the_best(
    tmp_path: Path, kept: FoldsResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Killed(BaseException):
        """Ends a training as SIGKILL does."""

    def killed(self: RunFolder) -> None:
        raise Killed

    runs = tmp_path / "runs"
    with monkeypatch.context() as context:
        context.setattr(RunFolder, "become_latest", killed)
        with pytest.raises(Killed):
            msnn.train_folds(model(tmp_path), FRAME, runs=runs)
    assert not (runs / "gain" / "latest").is_symlink()
    resumed = msnn.train_folds(model(tmp_path), FRAME, runs=runs, resume=True)
    assert [fold.monitor for fold in resumed.folds] == [fold.monitor for fold in kept.folds]
    assert (runs / "gain" / "latest").resolve().name == f"fold_{resumed.best.number}"
    with pytest.raises(msnn.SpecError, match="E0915"):
        msnn.train_folds(model(tmp_path), FRAME, runs=runs, resume=True)


def test_data_without_folds(tmp_path: Path) -> None:
    for more in ("", "data: {source: {train: no.csv}, split: {val: 0.2, by: fraction}}\n"):
        with pytest.raises(msnn.SpecError) as caught:
            msnn.train_folds(model(tmp_path, STAGE + more), FRAME, runs=tmp_path / "runs")
        (found,) = caught.value.diagnostics
        assert found.code == "E0947"
        assert (found.span is None) == (not more)
    assert not (tmp_path / "runs").exists()


def test_frames_of_sets_have_no_folds(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="one set"):
        msnn.train_folds(model(tmp_path), {"train": FRAME, "val": FRAME}, runs=None)
