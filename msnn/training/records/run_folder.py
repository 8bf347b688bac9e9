"""Manages the folder of a run, its lock, and the link `latest` to the last one."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, cast

from backends.files.atomic_write import naming, sync, write_bytes, write_text
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.errors.learning.runs import still_runs
from msnn.model.model_files import SubmodelFile
from msnn.model.saved_run import (
    CHECKPOINT,
    DESCRIPTION,
    LATEST,
    METRICS,
    PARAMETERS,
    PARTS,
    SPEC,
    WEIGHTS,
    leads_to,
    read_json,
)
from msnn.model.weights.covariance import COVARIANCE, Covariance, write_covariance
from msnn.model.weights.kept_starts import STARTS, KeptStarts, write_starts
from msnn.model.weights.weights_file import write_weights
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.records.curves import MetricsLog, finite
from msnn.training.records.run_record import as_it_ran
from spec_schema.diagnostics.diagnostic import SpecError


@dataclass(frozen=True, slots=True)
class RunFolder:
    """The folder of one run, `runs/<program>/<time>`; each file in it is replaced atomically."""

    path: Path
    program: Program
    latest: Path | None
    """The link to the last run; None for one of several runs, such as a fold."""
    is_durable: bool = True
    """True if `run.json` and the renaming of weights are synchronised with the disk.

    The contents of weights and checkpoints always are, with the names of the other files.
    """

    @property
    def weights(self) -> Path:
        return self.path / WEIGHTS

    @property
    def checkpoint(self) -> Path:
        return self.path / CHECKPOINT

    def write_weights(self, weights: Mapping[str, FloatArray]) -> None:
        """Writes the weights of the run."""
        write_weights(self.weights, weights, self.program, named_later=not self.is_durable)

    def become_latest(self) -> None:
        """Points `latest` to this run, so that other commands use its weights."""
        if self.latest is not None:
            _point(self.latest, self._target(self.latest))

    @property
    def is_latest(self) -> bool:
        """True if `latest` points to this run."""
        link = self.latest
        return link is not None and leads_to(link) == self._target(link)

    def _target(self, link: Path) -> Path:
        """The path of the run relative to `link`."""
        return self.path.relative_to(link.parent)

    def has(self, error: OSError) -> bool:
        """True if an error of the operating system is about a file in this folder."""
        return isinstance(error.filename, str) and self.path in Path(error.filename).parents

    @property
    def metrics(self) -> Path:
        return self.path / METRICS

    def metrics_log(self) -> MetricsLog:
        """The writer of `metrics.jsonl`."""
        return MetricsLog(self.metrics)

    def sync_metrics(self) -> int:
        """Synchronises `metrics.jsonl` with the disk, and returns its length in bytes."""
        if not self.metrics.is_file():
            return 0
        with naming(self.metrics):
            sync(self.metrics)
        return self.metrics.stat().st_size

    def go_on_from(self, metrics: int) -> None:
        """Prepares a resumed run: cuts `metrics.jsonl` to the length `metrics` in bytes that it had
        at the checkpoint.

        Incomplete files are removed too.
        """
        # incomplete files of the killed process
        for left in self.path.glob(".*.part"):
            left.unlink()
        if self.metrics.is_file():
            # epochs after the checkpoint are trained again and would stand there twice
            os.truncate(self.metrics, metrics)

    def write_parameters(self, record: Mapping[str, Any]) -> None:
        """Writes `parameters.json`: the learned values with their standard errors."""
        text = json.dumps(finite(record), ensure_ascii=False, indent=2)
        write_text(self.path / PARAMETERS, text + "\n")

    def write_covariance(self, found: Covariance | None) -> None:
        """Writes the covariance of the learned parameters; None removes an outdated one."""
        if found is None:
            # one of an earlier stage would belong to other weights
            (self.path / COVARIANCE).unlink(missing_ok=True)
        else:
            write_covariance(self.path / COVARIANCE, found)

    def write_starts(self, found: KeptStarts | None) -> None:
        """Writes the initial states of the training recordings; None removes outdated ones."""
        if found is None:
            (self.path / STARTS).unlink(missing_ok=True)
        else:
            write_starts(self.path / STARTS, found)

    def write_description(
        self, record: Mapping[str, Any], spec_text: str | None, parts: Sequence[SubmodelFile] = ()
    ) -> None:
        """Writes `run.json` (resolved stages, data) and copies of the spec and its sub-models."""
        self._describe(record)
        if spec_text is not None:
            write_text(self.path / SPEC, spec_text)
        for part in parts:
            write_text(self.path / PARTS / part.kept_as, part.text)
            if part.file is not None:
                place = self.path / PARTS / f"{part.name}.safetensors"
                write_bytes(place, part.file.read_bytes())

    def description(self) -> dict[str, Any]:
        """The record of `write_description`; empty if it cannot be read."""
        return read_json(self.path / DESCRIPTION)

    def write_bits_of(self, plan: StagePlan) -> None:
        """Corrects in `run.json` the reproducibility of a stage that fell back from its plan.

        This is written immediately, so that a killed and resumed run keeps it.
        """
        record = self.description()
        self._describe({**record, "bits": as_it_ran(record.get("bits", {}), plan)})

    def end(self) -> dict[str, Any]:
        """The last record of `write_end`; empty before the first."""
        found = self.description().get("end", {})
        return cast("dict[str, Any]", found) if isinstance(found, dict) else {}

    def write_end(self, end: Mapping[str, Any]) -> None:
        """Adds to `run.json` how the run ended, or its state so far."""
        # read again: the file may have been written by a process before this one
        self._describe({**self.description(), "end": dict(end)})

    def _describe(self, record: Mapping[str, Any]) -> None:
        text = json.dumps(record, ensure_ascii=False, indent=2)
        write_text(self.path / DESCRIPTION, text + "\n", durable=self.is_durable)


def new_run_folder(program: Program, runs: Path) -> RunFolder:
    """A new folder `runs/<program>/<local time>`, with a number if the second is already used."""
    parent = runs / program.name
    stamp = datetime.now().astimezone().strftime("%Y-%m-%d_%H-%M-%S")
    # apart: a file or a dead link where this folder should be is no run of the same second
    parent.mkdir(parents=True, exist_ok=True)
    for number in range(1, 1000):
        path = parent / (stamp if number == 1 else f"{stamp}_{number}")
        try:
            # making the folder is the test: two processes that look first would both find it free
            path.mkdir()
        except FileExistsError:
            continue
        return RunFolder(path, program, parent / LATEST)
    message = f"a thousand runs started in {parent} within one second"
    raise FileExistsError(message)


def own_folder(program: Program, folder: Path, *, is_durable: bool) -> RunFolder:
    """A new folder for a run without `latest`, such as one fold of several."""
    # no `exist_ok`: an existing folder belongs to another run
    folder.mkdir(parents=True)
    return RunFolder(folder, program, None, is_durable)


def _point(link: Path, target: Path) -> None:
    """Creates a symbolic link to `target`, replacing an older one atomically.

    If links are not permitted, as for most users of Windows, it is a text file with the target.
    """
    # a link cannot be changed, only replaced: between removing and making it `latest` would be
    # missing
    # by process: several trainings may end at once
    temporary = link.with_name(f".{link.name}.{os.getpid()}")
    temporary.unlink(missing_ok=True)
    try:
        temporary.symlink_to(target, target_is_directory=True)
    except (OSError, NotImplementedError):
        temporary.write_text(f"{target.as_posix()}\n", encoding="utf-8")
    temporary.replace(link)
    sync(link.parent)


@contextmanager
def held(run: Path | None) -> Generator[None]:
    """Locks the folder of a run; SpecError if another process holds the lock.

    The system releases the lock when the process ends. There is no lock on Windows, where folders
    cannot be opened, and on file systems without locks.
    """
    if run is None or sys.platform == "win32":
        yield
        return
    import fcntl  # of POSIX alone

    # the folder itself: a lock file would stay behind where the process is killed
    number = os.open(run, os.O_RDONLY)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SpecError((still_runs(str(run)),)) from None
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(number)


@contextmanager
def alone(run: Path) -> Generator[None]:
    """A context in which no other process uses `alone` for this run's folder; waits until it is
    free.

    The folder need not exist yet. There is no lock on Windows.
    """
    if sys.platform == "win32":
        yield
        return
    lock = run.with_name(f".{run.name}.lock")
    lock.parent.mkdir(parents=True, exist_ok=True)
    number = _locked(lock)
    try:
        yield
    finally:
        # while it is held: who waits for it sees that the file is gone, and makes another
        lock.unlink(missing_ok=True)
        os.close(number)


def _locked(lock: Path) -> int:
    import fcntl

    while True:
        number = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(number, fcntl.LOCK_EX)
            if _is_there(lock, number):
                return number
        except BaseException:  # an interrupt while it waits
            os.close(number)
            raise
        os.close(number)


def _is_there(lock: Path, number: int) -> bool:
    """True if the open file is still the file at that path; another process may have removed it."""
    try:
        return os.path.samestat(os.fstat(number), lock.stat())
    except FileNotFoundError:
        return False
