"""Trains models: once, per fold, or in a user-written loop."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from msnn.data.dataset import Dataset
from msnn.model.model import Model
from msnn.model.model_data import given_in, measured, sources_of
from msnn.model.weights.given_weights import Weights
from msnn.packages import TORCH

if TYPE_CHECKING:
    from msnn.api.results.trainings import ShownFolds, ShownTraining
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
    from msnn.api.results.trainings import shown_training
    from msnn.api.shown_progress import heard_by
    from msnn.reports.training_summary import Recorded
    from msnn.training import train as engine
    from msnn.training.engines.what_trains import require_what_trains
    from msnn.training.run_line import begun, diverged, ended, log
    from msnn.training.training_result import TrainingDivergedError, TrainingInterruptedError

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
    from msnn.api.results.trainings import ShownFolds
    from msnn.api.shown_progress import heard_by
    from msnn.data.reading.frames import refuse_sets
    from msnn.reports.training_summary import Recorded
    from msnn.training import folds
    from msnn.training.engines.what_trains import require_what_trains

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
