"""Keeps the best weights and a checkpoint of a training on disk, by the clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from msnn.data.dataset import FloatArray
from msnn.training.records.checkpoint import Checkpoint, write_checkpoint
from msnn.training.records.resumable_run import NotedProgress
from msnn.training.records.run_folder import RunFolder

WRITING = 0.5
"""Seconds of those that may be lost in which the files are written: they wait for the disk."""

RECENT = 1.0
"""Seconds of work that are too few to be kept at the end of a stage."""


@dataclass(slots=True)
class Safekeeping:
    """Writes weights, where they are better, and checkpoints; nothing for a run without files.

    Each is a file that is replaced in one step and has reached the disk, the weights first: what a
    full disk or a cut of power leaves is one of the states before.
    """

    folder: RunFolder | None
    progress: NotedProgress
    most_lost: float
    """Seconds of work that a killed run loses at most."""
    now: Callable[[], float] = time.monotonic
    _saved: float = field(init=False)
    _weights: Mapping[str, FloatArray] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self._saved = self.now()

    def is_due(self, ahead: float) -> bool:
        """Whether `ahead` seconds of further work are too many to go without a checkpoint."""
        since = self.now() - self._saved
        return self.folder is not None and since + ahead + WRITING >= self.most_lost

    @property
    def is_stale(self) -> bool:
        """Whether the last checkpoint is more than a moment old."""
        return self.folder is not None and self.now() - self._saved >= RECENT

    def save(self, checkpoint: Checkpoint, best: Mapping[str, FloatArray]) -> None:
        """Writes where the run stands; the clock starts again."""
        if self.folder is None:
            return
        # the weights first: a checkpoint never speaks of weights that are not on the disk
        self.save_weights(best)
        self.progress.keep()
        metrics = self.folder.sync_metrics()
        write_checkpoint(self.folder.checkpoint, replace(checkpoint, metrics=metrics))
        self._saved = self.now()

    def save_weights(self, weights: Mapping[str, FloatArray]) -> None:
        """Writes the weights of the run, unless they stand there."""
        # by identity: better weights are always new arrays
        if self.folder is not None and weights is not self._weights:
            self.folder.write_weights(weights)
            self._weights = weights
