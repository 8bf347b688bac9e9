"""Saves the best weights and a checkpoint of a training at regular times."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from msnn.data.dataset import FloatArray
from msnn.training.records.checkpoint import Checkpoint, write_checkpoint
from msnn.training.records.resumable_run import NotedProgress
from msnn.training.records.run_folder import RunFolder

WRITING = 0.5
"""Seconds reserved for writing the files, out of `most_lost`."""

RECENT = 1.0
"""Seconds of work that are not worth a checkpoint at the end of a stage."""


@dataclass(slots=True)
class Safekeeping:
    """Writes improved weights and checkpoints; does nothing for a run without files.

    Files are replaced atomically and synchronised with the disk, the weights first. After a full
    disk or power failure, an earlier state remains.
    """

    folder: RunFolder | None
    progress: NotedProgress
    most_lost: float
    """Maximum number of seconds of work that a killed run loses."""
    now: Callable[[], float] = time.monotonic
    _saved: float = field(init=False)
    _weights: Mapping[str, FloatArray] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self._saved = self.now()

    def is_due(self, ahead: float) -> bool:
        """True if a checkpoint is due before `ahead` seconds of further work."""
        since = self.now() - self._saved
        return self.folder is not None and since + ahead + WRITING >= self.most_lost

    @property
    def is_stale(self) -> bool:
        """True if the last checkpoint is older than `RECENT` seconds."""
        return self.folder is not None and self.now() - self._saved >= RECENT

    def save(self, checkpoint: Checkpoint, best: Mapping[str, FloatArray]) -> None:
        """Writes a checkpoint and restarts the clock."""
        if self.folder is None:
            return
        # the weights first: a checkpoint never speaks of weights that are not on the disk
        self.save_weights(best)
        self.progress.keep()
        metrics = self.folder.sync_metrics()
        write_checkpoint(self.folder.checkpoint, replace(checkpoint, metrics=metrics))
        self._saved = self.now()

    def save_weights(self, weights: Mapping[str, FloatArray]) -> None:
        """Writes the weights of the run, unless they are already written."""
        # by identity: better weights are always new arrays
        if self.folder is not None and weights is not self._weights:
            self.folder.write_weights(weights)
            self._weights = weights
