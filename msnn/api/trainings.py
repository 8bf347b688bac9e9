"""Trains models once, per fold, or in a user-written loop, and shows the results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from msnn.api.results import Shown
from msnn.data.dataset import Dataset
from msnn.model.model import Model
from msnn.model.model_data import given_in, measured, sources_of
from msnn.model.weights.weights_file import Weights
from msnn.packages import TORCH
from msnn.reports.learned_functions import learned_functions
from msnn.reports.run_plots import functions_of_run, plot_run
from msnn.reports.run_summary import read_run
from msnn.reports.training_summary import Recorded, parameters_cells, stages_cells
from msnn.tables import Table, count
from msnn.training.folds import FoldsResult, folds_cells, folds_record
from msnn.training.records.learned.parameters_record import parameters_record
from msnn.training.training_result import TrainingResult

if TYPE_CHECKING:
    from msnn.api.shown_progress import Hearer
    from msnn.data.reading.frames import Frames
    from msnn.training.ranks.training_ranks import TrainingRanks
    from msnn.training.records.training_options import TrainingOptions
    from msnn.training.stage_loss_module import StageLoss


def train(
    model: Model,
    data: Frames | None = None,
    *,
    data_root: str | Path | None = None,
    runs: str | Path | None = "runs",
    resume: bool = False,
    tensorboard: bool = False,
    device: str = "cpu",
    weights: Weights | None = None,
    progress: Hearer = None,
    ranks: TrainingRanks | None = None,
) -> ShownTraining:
    """Trains the stages of a spec on its data, and returns the best weights of the last stage.

        result = msnn.train(msnn.load("plant.msnn.yaml"))
        print(result.weights["k"], result.folder)
        result.to_frame()  # result.plot(); a notebook shows the tables

    `data` are pandas or polars frames or mappings of arrays, with the columns named in the spec,
    one per recording: a single one, a list, or either for each set, `{"train": a, "val": b}`. None
    means the data of the spec. `runs` None writes no files and computes no standard errors, nor the
    covariance for prediction intervals; `tensorboard` adds curves to the files. `device` is the
    device of torch: cpu, cuda, cuda:N or auto. `weights` are the initial weights of the first
    stage, by default the initial values.

    `progress` None shows lines in a terminal or notebook; True always, False never; a function
    receives every event, a `StageStart`, `EpochEnd`, `StageEnd` or a warning. `ranks` are the
    processes of a distributed training, of which only the first writes files: `GlooRanks()` of
    `msnn.training.ranks` in each process started by torchrun. Raises SpecError,
    TrainingDivergedError, TrainingInterruptedError and MissingExtraError.
    """
    from msnn.api.shown_progress import heard_by
    from msnn.reports.training_summary import Recorded
    from msnn.training import train as engine
    from msnn.training.engines.devices import require_what_trains
    from msnn.training.training_result import (
        TrainingDivergedError,
        TrainingInterruptedError,
        begun,
        diverged,
        ended,
        log,
    )

    require_what_trains(model.spec.train)
    # all ranks have the same weights: the files of one are enough
    if ranks is not None and not ranks.is_first:
        runs, tensorboard = None, False
    options = replace(_options(model, runs, tensorboard, device), resume=resume, ranks=ranks)
    first = given_in(model, weights)
    dataset = measured(model, data, data_root, "training")
    line = begun(model, dataset)
    heard = Recorded(heard_by(progress), keeps_epochs=options.runs is None)
    with sources_of(model):
        try:
            found = engine.train(model.program, dataset, model.spec.train, options, heard, first)
        except TrainingDivergedError as error:
            # before it is raised: a comparison counts what diverged, too
            log(options.runs, diverged(line, error))
            raise TrainingDivergedError(
                error.diagnostic,
                shown_training(error.result, model, heard),
                is_latest=error.is_latest,
                sources=model.sources,
                # one error, not two: the engine's own says the same without tables
            ) from None
        except TrainingInterruptedError as error:
            shown = shown_training(error.result, model, heard)
            raise TrainingInterruptedError(shown) from None
    log(options.runs, ended(line, found, options.runs))
    return shown_training(found, model, heard)


def train_folds(
    model: Model,
    data: Frames | None = None,
    *,
    data_root: str | Path | None = None,
    runs: str | Path | None = "runs",
    resume: bool = False,
    tensorboard: bool = False,
    device: str = "cpu",
    weights: Weights | None = None,
    progress: Hearer = None,
) -> ShownFolds:
    """Trains once per fold of `split: {by: kfold, k}`, and evaluates each on its held-out fold.

        result = msnn.train_folds(msnn.load("plant.msnn.yaml"))
        print([fold.monitor for fold in result.folds], result.best.training.weights)

    Arguments and errors are as in `train`; frames form one set, which is divided into folds. Raises
    SpecError also if the data have no folds.
    """
    from msnn.api.shown_progress import heard_by
    from msnn.data.reading.frames import refuse_sets
    from msnn.reports.training_summary import Recorded
    from msnn.training import folds
    from msnn.training.engines.devices import require_what_trains

    # frames for each set leave nothing for folds to divide
    refuse_sets(data)
    require_what_trains(model.spec.train)
    options = replace(_options(model, runs, tensorboard, device), resume=resume)
    first = given_in(model, weights)

    def read(one: Model) -> Dataset:
        return measured(one, data, data_root, "training")

    heard = Recorded(heard_by(progress), keeps_epochs=options.runs is None)
    with sources_of(model):
        found = folds.train_folds(model, read, options, heard, first)
    return ShownFolds(
        folds=found.folds,
        folder=found.folder,
        count=found.count,
        model=model,
        recorded=heard,
    )


def stage_loss(
    model: Model,
    data: Frames | None = None,
    *,
    data_root: str | Path | None = None,
    stage: int = 0,
    device: str = "cpu",
    weights: Weights | None = None,
) -> StageLoss:
    """The loss of one stage as a torch module; forward and backward use the kernel.

        loss = msnn.stage_loss(model)
        optimizer = torch.optim.RAdam(loss.parameters(), lr=1e-3)
        for epoch in range(100):
            for batch in loss.batches(epoch):
                optimizer.zero_grad()
                loss(batch).backward()
                optimizer.step()
        weights = loss.weights()

    Rollouts, batches, dtype, `freeze` and loss weights are those of the stage; its optimiser,
    schedule and gradient clipping are ignored. `data` and `device` are as in `train`. Raises
    SpecError and MissingExtraError.
    """
    # before the data are read: the message needs none
    TORCH.require("gives the loss of a stage as a module")
    from msnn.training.engines.devices import find_device
    from msnn.training.stage_loss_module import stage_loss as opened

    place, first = find_device(device), given_in(model, weights)
    dataset = measured(model, data, data_root, "training")
    with sources_of(model):
        return opened(model.program, dataset, model.spec.train, stage, first, place)


def _options(
    model: Model, runs: str | Path | None, tensorboard: bool, device: str
) -> TrainingOptions:
    from msnn.training.engines.devices import find_device
    from msnn.training.records.training_options import options_for

    kept = None if runs is None else Path(runs)
    return options_for(model, runs=kept, tensorboard=tensorboard, device=find_device(device))


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ShownTraining(Shown, TrainingResult):
    """A training with its tables; `to_frame` has one row per element of every parameter."""

    model: Model
    recorded: Recorded

    def _said(self) -> str:
        stages = count(len(self.stages), "stage")
        best = f", best {self.stages[-1].best_value:.6g}" if self.stages else ""
        kept = "kept nowhere" if self.folder is None else f"kept in {self.folder}"
        return f"TrainingResult: {stages}{best}, {kept}"

    def _record(self) -> dict[str, Any]:
        return parameters_record(self.model.program, self.weights, self.standard_errors)

    def _tables(self) -> Sequence[Table]:
        return [stages_cells(self.recorded.stages), parameters_cells(self._record())]

    def _columns(self) -> Mapping[str, Sequence[object]]:
        found = [
            (
                each["name"],
                ",".join(map(str, np.unravel_index(k, each["shape"]))) if each["shape"] else "",
                each["unit"] or "",
                each["initial"][k],
                value,
                None if each["standard_errors"] is None else each["standard_errors"][k],
                each["learn"],
            )
            for each in self._record()["parameters"]
            for k, value in enumerate(each["values"])
        ]
        names = ("parameter", "index", "unit", "initial", "learned", "std_error", "learn")
        return {name: [row[i] for row in found] for i, name in enumerate(names)}

    def _draw(self, path: Path) -> Path:
        return _drawn(path, self.model, self, self.recorded)


def shown_training(found: TrainingResult, model: Model, recorded: Recorded) -> ShownTraining:
    """The result of a training as an object with tables and plots."""
    known = {field.name: getattr(found, field.name) for field in fields(TrainingResult)}
    return ShownTraining(**known, model=model, recorded=recorded)


@dataclass(frozen=True, slots=True, repr=False)
class ShownFolds(Shown, FoldsResult):
    """Trainings of folds with their table; the plot shows the best fold."""

    model: Model
    recorded: Recorded

    def _said(self) -> str:
        reached = f"best {self.best.monitor:.6g} (fold {self.best.number})"
        return f"FoldsResult: {count(self.count, 'fold')}, {reached}"

    def _tables(self) -> Sequence[Table]:
        return [folds_cells(self)]

    def _columns(self) -> Mapping[str, Sequence[object]]:
        rows: list[dict[str, Any]] = [
            {"fold": fold["fold"], "monitor": fold["monitor"], **metric}
            for fold in folds_record(self)["folds"]
            for metric in fold["metrics"] or [dict[str, Any]()]
        ]
        names = dict.fromkeys(name for row in rows for name in row)
        return {name: [row.get(name) for row in rows] for name in names}

    def _draw(self, path: Path) -> Path:
        return _drawn(path, self.model, self.best.training, self.recorded)


def _drawn(path: Path, model: Model, found: TrainingResult, recorded: Recorded) -> Path:
    """Plots the run in the folder, including epochs before it was resumed; else recorded events.

    Without a folder it shows filter taps only, because the data are no longer available.
    """
    if found.folder is None:
        return plot_run(path, recorded.epochs, learned_functions(model, found.weights, None))
    run = read_run(found.folder)
    return plot_run(path, [stage.epochs for stage in run.stages], functions_of_run(run))
