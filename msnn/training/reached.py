"""Keeps the last position of a run in memory, in case one of its processes is lost."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

from msnn.errors.ranks import rank_lost
from msnn.training.ranks.training_ranks import RankLostError
from msnn.training.records.checkpoint import Checkpoint
from msnn.training.records.resumable_run import NotedProgress
from msnn.training.records.run_folder import RunFolder
from msnn.training.records.safekeeping import Safekeeping
from spec_schema.diagnostics.diagnostic import SpecError


@dataclass(slots=True)
class Reached:
    """The last position from which the run can continue."""

    checkpoint: Checkpoint

    @contextmanager
    def kept(
        self, folder: RunFolder | None, safe: Safekeeping, progress: NotedProgress
    ) -> Generator[None]:
        """Saves the position if another process is lost, and raises SpecError."""
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
