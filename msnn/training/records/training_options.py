"""Defines options of a training that are not part of the spec."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from compiler.elaboration.names import rule_of
from msnn.data.dataset import FloatArray
from msnn.model.model import Model
from msnn.model.model_files import SubmodelFile
from msnn.model.model_weights import redrawn_weights
from msnn.model.saved_run import CHECKPOINT
from msnn.training.engines.devices import CPU, Device
from msnn.training.ranks.training_ranks import TrainingRanks
from msnn.training.records.run_folder import held
from spec_schema.sections.layers import Layer, LocalModel
from spec_schema.sections.spec import Spec


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingOptions:
    """Options of a training that are not in the spec: its folder, checkpoints, device, curves.

    Without `runs` and `folder` no files are written. `resume` continues the newest unfinished run.
    """

    runs: Path | None = Path("runs")
    resume: bool = False
    most_lost: float = 5.0
    """Maximum number of seconds of work that a killed run loses."""
    folder: Path | None = None
    """The folder of this run, created or resumed, instead of a new folder in `runs`."""
    given_run: Path | None = None
    """The run that was given instead of a spec; `resume` continues it if it has not ended."""
    spec_text: str | None = None
    """The text of the spec, saved with the weights."""
    tensorboard: bool = False
    """True to write curves for TensorBoard."""
    spec_file: str | None = None
    """Path of the spec, for commands that continue from the run."""
    settings: tuple[str, ...] = ()
    """Values overridden by `--set`."""
    parts: tuple[SubmodelFile, ...] = ()
    """The files of sub-models, saved with the run."""
    black_boxes: frozenset[str] = frozenset()
    """Layers whose individual weights have no physical meaning."""
    device: Device = CPU
    """Where torch computes."""
    has_errors: bool = True
    """True to estimate standard errors at the end, which needs an additional kernel."""
    ranks: TrainingRanks | None = None
    """The processes that train together; only the first one has `runs`."""
    ends_in_log: bool = False
    """True if a log records the result: the last second of work is then not saved separately."""
    redrawn: Callable[[int], Mapping[str, FloatArray]] | None = None
    """Returns random initial values by number, for further attempts with `starts:`."""


def options_for(
    model: Model,
    *,
    runs: Path | None,
    tensorboard: bool = False,
    device: Device = CPU,
    has_errors: bool = True,
) -> TrainingOptions:
    """The options of a run that saves this model."""
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
    """The options of a run in `folder`, which continues from the checkpoint there.

    Without a checkpoint, or if `goes_on` is False, deletes the folder: the run then begins again.
    Raises SpecError if another process trains in the folder to delete.
    """
    resume = goes_on and (folder / CHECKPOINT).is_file()
    if folder.exists() and not resume:
        with held(folder):
            shutil.rmtree(folder)  # it was killed in its first seconds
    return replace(options, folder=folder, resume=resume)


def black_boxes(spec: Spec) -> frozenset[str]:
    """The full names of layers with `black_box`, whose weights have no physical meaning.

    A local model with such cells is one too.
    """
    return frozenset(name for name, layer in spec.layers.items() if _is_one(layer))


def _is_one(layer: Layer) -> bool:
    settings = layer.chosen()
    return rule_of(
        settings.cell.chosen() if isinstance(settings, LocalModel) else settings
    ).is_black_box
