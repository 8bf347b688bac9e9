"""Checks that several processes train the same model, and saves the run if one process is lost."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msnn.data.dataset import FloatArray
from msnn.errors.learning.engines import rank_lost, ranks_differ
from msnn.training.ranks.training_ranks import RankLostError, TrainingRanks, weight_bytes
from msnn.training.records.checkpoint import Checkpoint, read_checkpoint
from msnn.training.records.resumable_run import NotedProgress, Safekeeping
from msnn.training.records.run_folder import RunFolder
from spec_schema.diagnostics.diagnostic import SpecError

_ALIKE = ("spec_sha256", "parts", "versions", "stages", "data")
"""Entries of `run.json` that must be equal."""


def check_same_training(ranks: TrainingRanks | None, record: Mapping[str, Any]) -> None:
    """Raises SpecError if spec, data or versions differ between ranks."""
    for key in _ALIKE if ranks is not None else ():
        content = json.dumps(record[key], sort_keys=True, default=str).encode()
        _check(ranks, content, f"`{key}` of `run.json`")


def check_same_engine(ranks: TrainingRanks | None, engine: object, dtype: str) -> None:
    """Raises SpecError if a stage has different engines on different ranks."""
    _check(ranks, f"{type(engine).__name__} {dtype}".encode(), "the engine of a stage")


def check_same_weights(ranks: TrainingRanks | None, weights: Mapping[str, FloatArray]) -> None:
    """Raises SpecError if the weights of the ranks differ in any bit."""
    if ranks is not None:
        _check(ranks, weight_bytes(weights), "the bits of the weights")


def checkpoint_of_first(
    ranks: TrainingRanks | None, own: Path | None, checkpoint: Checkpoint | None
) -> Checkpoint | None:
    """The checkpoint of rank 0, sent to all ranks: each continues the training from it.

    `own` is the file of this process, None on other ranks than the first.
    """
    if ranks is None:
        return checkpoint
    content = b"" if own is None or checkpoint is None else own.read_bytes()
    content = ranks.from_first(content)
    if ranks.is_first or not content:
        return checkpoint
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "checkpoint.safetensors"
        file.write_bytes(content)
        return read_checkpoint(file)


def _check(ranks: TrainingRanks | None, content: bytes, what: str) -> None:
    if ranks is not None and not ranks.agree(content):
        raise SpecError((ranks_differ(what),))


@dataclass(slots=True)
class Reached:
    """The last checkpoint from which a training of several processes can continue."""

    checkpoint: Checkpoint

    @contextmanager
    def kept(
        self, folder: RunFolder | None, safe: Safekeeping, progress: NotedProgress
    ) -> Generator[None]:
        """A context in which a lost process ends the training: the checkpoint is saved, and
        SpecError raised.
        """
        try:
            yield
        except RankLostError as lost:
            if folder is not None:
                now = self.checkpoint
                leader = None if now.leader is None else now.leader.best
                best = leader if now.place is None else now.place.best
                safe.save(now, now.begin if best is None else best)
                folder.become_latest()
                progress.run_ended("interrupted")
            path = None if folder is None else str(folder.path)
            raise SpecError((rank_lost(str(lost), path),)) from lost
