"""Defines how a training is run and kept, beside what its spec says."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from msnn.data.dataset import FloatArray
from msnn.model.model import Model
from msnn.model.model_weights import redrawn_weights
from msnn.model.saved_run import CHECKPOINT
from msnn.model.spec_hash import SubmodelFile
from msnn.training.engines.devices import CPU, Device
from msnn.training.ranks.training_ranks import TrainingRanks
from msnn.training.records.learned.black_boxes import black_boxes
from msnn.training.records.run_lock import held


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingOptions:
    """The options of a run's folder: `runs` None writes no files; `resume` continues the newest."""

    runs: Path | None = Path("runs")
    resume: bool = False
    most_lost: float = 5.0
    """Seconds of work that a killed run loses at most."""
    folder: Path | None = None
    """Where this run is kept, to make or to go on in, instead of a fresh folder in `runs`."""
    given_run: Path | None = None
    """The run whose folder stood for the spec: where it has not ended `resume` goes on with it."""
    spec_text: str | None = None
    """The text of the spec, to be kept beside the weights."""
    tensorboard: bool = False
    """Curves for TensorBoard beside the weights."""
    spec_file: str | None = None
    """Its name, for the commands that go on from the run."""
    settings: tuple[str, ...] = ()
    """The values that `--set` has replaced in it."""
    parts: tuple[SubmodelFile, ...] = ()
    """Its sub-models, to be kept with it."""
    black_boxes: frozenset[str] = frozenset()
    """Its layers whose numbers mean nothing one by one."""
    device: Device = CPU
    """Where torch computes."""
    has_errors: bool = True
    """Whether standard errors are estimated at the end, which takes a kernel of its own."""
    ranks: TrainingRanks | None = None
    """The processes that train together; only the first one has `runs`."""
    ends_in_log: bool = False
    """Whether a log tells of its end: then its last second is trained again, not kept on disk."""
    redrawn: Callable[[int], Mapping[str, FloatArray]] | None = None
    """Other initial values, by number, for the further runs of a stage with `starts:`."""


def options_for(
    model: Model,
    *,
    runs: Path | None,
    tensorboard: bool = False,
    device: Device = CPU,
    has_errors: bool = True,
) -> TrainingOptions:
    """The options of a run that keeps this model."""
    return TrainingOptions(
        runs=runs,
        tensorboard=tensorboard,
        device=device,
        has_errors=has_errors,
        spec_text=model.text,
        spec_file=str(model.path),
        settings=model.settings,
        parts=model.parts,
        black_boxes=black_boxes(model.spec),
        given_run=model.run,
        redrawn=lambda draw: redrawn_weights(model, draw),
    )


def in_folder(options: TrainingOptions, folder: Path, *, goes_on: bool = True) -> TrainingOptions:
    """The same, kept in `folder`: what a checkpoint there left goes on, what has none begins."""
    resume = goes_on and (folder / CHECKPOINT).is_file()
    if folder.exists() and not resume:
        with held(folder):
            shutil.rmtree(folder)  # it was killed in its first seconds
    return replace(options, folder=folder, resume=resume)
