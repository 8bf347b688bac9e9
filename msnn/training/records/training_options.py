"""Defines how a training is run and kept, beside what its spec says."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from msnn.data.dataset import FloatArray
from msnn.model.spec_hash import SubmodelFile
from msnn.training.engines.devices import CPU, Device


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingOptions:
    """How a run is kept: `runs` None writes no files; `resume` goes on with the newest one."""

    runs: Path | None = Path("runs")
    resume: bool = False
    most_lost: float = 5.0
    """Seconds of work that a killed run loses at most."""
    fold: Path | None = None
    """The folder of one fold of a run, to make or to go on in, instead of a fresh one in `runs`."""
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
    redrawn: Callable[[int], Mapping[str, FloatArray]] | None = None
    """Other initial values, by number, for the further runs of a stage with `starts:`."""
