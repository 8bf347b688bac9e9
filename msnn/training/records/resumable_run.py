"""Opens the folder of a new or interrupted run, saves its position, and records its end."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from shutil import rmtree
from types import FrameType
from typing import Any, Literal

from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.errors.learning import stages as stage_errors
from msnn.errors.learning import training as errors
from msnn.model.saved_run import FOLD, LATEST, has_checkpoint, newest, spec_places
from msnn.training.records.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from msnn.training.records.progress import EpochEnd, Progress, StageEnd, StageStart
from msnn.training.records.run_folder import RunFolder, held, new_run_folder, own_folder
from msnn.training.records.run_record import differences
from msnn.training.records.training_options import TrainingOptions
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError, describe


def open_run(
    program: Program, options: TrainingOptions, record: Mapping[str, Any]
) -> tuple[RunFolder | None, Checkpoint | None]:
    """Creates the folder of a new run, or finds the folder and checkpoint of a run to resume.

    `record` is the content of `run.json`. Returns None twice if the run writes no files.
    """
    if options.runs is None:
        return None, None
    if not options.resume:
        folder = (
            new_run_folder(program, options.runs)
            if options.folder is None
            else own_folder(program, options.folder, is_durable=not options.ends_in_log)
        )
        begun = {
            "spec": options.spec_file,
            "spec_places": spec_places(options.spec_file, folder.path)
            if options.spec_file is not None
            else [],
            "settings": list(options.settings),
            "device": options.device.name,
        }
        try:
            folder.write_description({**record, **begun}, options.spec_text, options.parts)
        except OSError:
            # a run that does not say what it is of is none: nobody could go on with it or show it
            rmtree(folder.path, ignore_errors=True)
            raise
        return folder, None
    parent = options.runs / program.name
    if options.folder is not None:
        return _again(RunFolder(options.folder, program, None), record)
    given = options.given_run
    # a fold goes on with the other folds
    if given is not None and has_checkpoint(given) and not given.name.startswith(FOLD):
        # one that was taken elsewhere is none of those that `latest` chooses from
        if not _is_same(given.parent, parent):
            return _again(RunFolder(given, program, None), record)
        found = parent / given.name
    else:
        found = newest(parent, has_checkpoint)
    if found is None:
        raise SpecError((errors.no_checkpoint(str(parent)),))
    return _again(RunFolder(found, program, parent / LATEST), record)


def _is_same(one: Path, other: Path) -> bool:
    return os.path.realpath(one) == os.path.realpath(other)


def _again(folder: RunFolder, record: Mapping[str, Any]) -> tuple[RunFolder, Checkpoint]:
    # a run that another process is still at is not taken over
    with held(folder.path):
        checkpoint = read_checkpoint(folder.checkpoint)
        changes = differences(folder.description(), record)
        if changes:
            raise SpecError((stage_errors.another_run(str(folder.path), changes),))
        # only now: a run of something else stays as it is
        folder.go_on_from(checkpoint.metrics)
        return folder, checkpoint


class NotedProgress:
    """Forwards every event to `Progress`, and saves epochs in `metrics.jsonl`, other events in
    `run.json`.
    """

    def __init__(self, shown: Progress, folder: RunFolder | None) -> None:
        self._shown, self._folder = shown, folder
        # a run that goes on keeps what it said before
        before = {} if folder is None else folder.end()
        self._said: list[Diagnostic] = []
        self._reasons: dict[str, str] = before.get("stages", {})
        self._rates: dict[str, float] = before.get("rates", {})
        self._warnings: list[str] = before.get("warnings", [])
        self._kept = self._lines()
        self._metrics = None if folder is None else folder.metrics_log()

    def stage_started(self, event: StageStart) -> None:
        self._shown.stage_started(event)

    def epoch_ended(self, event: EpochEnd) -> None:
        if self._metrics is not None:
            self._metrics.append(event.record())
        self._shown.epoch_ended(event)

    def stage_ended(self, event: StageEnd) -> None:
        self._reasons[event.stage] = event.reason
        self._shown.stage_ended(event)

    def rate_found(self, stage: str, attempt: int, rate: float) -> None:
        """Records the learning rate that was found for a stage."""
        self._rates[stage if attempt == 0 else f"{stage}, run {attempt + 1}"] = rate

    def warned(self, diagnostic: Diagnostic) -> None:
        if diagnostic in self._said:  # of what is no stage's own every stage warns
            return
        self._said.append(diagnostic)
        self._note(diagnostic)
        self._shown.warned(diagnostic)

    @property
    def said(self) -> tuple[Diagnostic, ...]:
        """All warnings of this run so far, each once."""
        return tuple(self._said)

    def run_ended(
        self,
        state: Literal["finished", "interrupted", "diverged"],
        said: Sequence[Diagnostic] = (),
        zero: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        """Writes how the run ended to `run.json`, with its last warnings and the slices
        that are 0.
        """
        for diagnostic in said:
            self._note(diagnostic)
        if self._folder is not None:
            found = {"zero_slices": list(zero)} if zero else {}
            self._folder.write_end({"state": state, **self._lines(), **found})

    def close(self) -> None:
        """Closes the file of epochs."""
        if self._metrics is not None:
            self._metrics.close()

    def keep(self) -> None:
        """Writes the current state to `run.json`, in case the run is killed."""
        # each keeping waits for the disk
        if self._folder is not None and self._lines() != self._kept:
            self._kept = self._lines()
            self._folder.write_end(self._kept)

    def _lines(self) -> dict[str, Any]:
        rates = {"rates": dict(self._rates)} if self._rates else {}
        return {"stages": dict(self._reasons), **rates, "warnings": list(self._warnings)}

    def _note(self, diagnostic: Diagnostic) -> None:
        line = describe(diagnostic)
        if line not in self._warnings:  # a resumed run warns of the same again
            self._warnings.append(line)


WRITING = 0.5
"""Seconds reserved for writing the files, out of `most_lost`."""

RECENT = 1.0
"""Seconds of work that are not worth a checkpoint at the end of a stage."""


@dataclass(slots=True)
class Safekeeping:
    """Writes checkpoints and improved weights of a run; does nothing for a run without files.

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
        """True if a checkpoint must be written now, because the next part of the work takes `ahead`
        seconds.
        """
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


@contextmanager
def end_on_interrupt(*, second_kills: bool = True) -> Generator[threading.Event]:
    """A context with an event that the first Ctrl-C or SIGTERM sets; the second one raises
    KeyboardInterrupt.

    torchrun forwards signals that its processes have already received. There (`second_kills` False)
    the second signal is a repetition of the first.
    """
    asked = threading.Event()
    # Python hands signals to the main thread alone and refuses handlers elsewhere
    if threading.current_thread() is not threading.main_thread():
        yield asked
        return

    def ask(number: int, frame: FrameType | None) -> None:
        del number, frame
        if asked.is_set() and second_kills:
            raise KeyboardInterrupt
        asked.set()

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
