"""Runs trainings, cross-validations and exports in a process, kills it, and checks what remains."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Literal

import numpy as np

import msnn
from msnn.cli.interrupts import interrupt_on_signals, is_interrupt
from msnn.data.dataset import Dataset
from msnn.model.model import Model
from msnn.model.model_data import measured
from msnn.model.saved_run import CHECKPOINT, DESCRIPTION, WEIGHTS
from msnn.training.folds import train_folds
from msnn.training.records.checkpoint import read_checkpoint
from msnn.training.records.run_folder import METRICS
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train as train_stages
from msnn.training.training_result import TrainingInterruptedError

Kind = Literal["train", "folds", "export"]

_SPEC = """
msnn: 1
name: gain
sample_time: 1 s
inputs: {x: m, u: m}
parameters: {a: 0.5, b: 0.0}
outputs:
  x_next: {expr: "a*x + b*u", predicts: "x[t+1]", unit: m}
data: {source: {train: none.csv}, split: {by: kfold, k: 3, fold: 1}}
train:
  - {epochs: EPOCHS, batch: 16, dtype: float64}
  - {epochs: EPOCHS, batch: 16, rollout: 4, freeze: a, starts: 2}
"""

_SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
_ROWS = 900
_MISTAKE, _STOPPED = 1, 3
"""Exit codes of processes that ended by an error, and since they were asked to."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of one case; `right` is true if it ended with the files of an undisturbed run."""

    kind: Kind
    kills: int
    lost: float
    """Seconds of work, at most."""
    right: bool
    latest_stayed: bool

    def is_good(self, most_lost: float) -> bool:
        """True if at most `most_lost` seconds of work were lost, and nothing else."""
        return self.right and self.latest_stayed and self.lost <= most_lost


@dataclass(frozen=True, slots=True)
class Subject:
    """A command to kill: how it runs in a folder, and the files of an undisturbed run."""

    kind: Kind
    run: Callable[[Path, bool], None]
    """In a folder; whether to go on with what is there."""
    seconds: float
    left: dict[str, bytes]
    exported_before: Callable[[Path], None]
    """Puts there what an earlier export has left."""


def subjects(place: Path, epochs: int, most_lost: float) -> dict[Kind, Subject]:
    """The commands to kill, each with the result of an undisturbed run."""
    model, frame = gain_model(place, epochs), gain_frame()
    trained = {"a": np.array(0.75), "b": np.array(0.25)}

    def options(folder: Path, resume: bool) -> TrainingOptions:
        return TrainingOptions(runs=folder / "runs", resume=resume, most_lost=most_lost)

    def divided(one: Model) -> Dataset:
        return _data(one, frame)

    def train(folder: Path, resume: bool) -> None:
        train_stages(model.program, _data(model, frame), model.spec.train, options(folder, resume))

    def folds(folder: Path, resume: bool) -> None:
        train_folds(model, divided, options(folder, resume), None, None)

    def export(folder: Path, resume: bool) -> None:
        del resume
        msnn.export(model, "c", folder / "c", trained)
        msnn.export(model, "onnx", folder / "onnx", trained)

    def exported_before(folder: Path) -> None:
        msnn.export(model, "c", folder / "c", {**trained, "a": np.array(0.5)})

    found: dict[Kind, Subject] = {}
    runs: dict[Kind, Callable[[Path, bool], None]] = {
        "train": train,
        "folds": folds,
        "export": export,
    }
    for kind, run in runs.items():
        folder = place / f"undisturbed_{kind}"
        folder.mkdir()
        _wait(_started(run, folder, False))  # it builds the kernels
        timed = place / f"timed_{kind}"
        timed.mkdir()
        began = time.monotonic()
        _wait(_started(run, timed, False))
        seconds = time.monotonic() - began
        found[kind] = Subject(kind, run, seconds, _left(kind, folder), exported_before)
    return found


def gain_model(place: Path, epochs: int) -> Model:
    """A small model whose two stages have `epochs` epochs each; writes its spec."""
    spec = place / "gain.msnn.yaml"
    spec.write_text(_SPEC.replace("EPOCHS", str(epochs)))
    return msnn.load(spec)


def gain_frame() -> dict[str, np.ndarray]:
    """Data that the model fits except for a small disturbance."""
    x, u = np.zeros(_ROWS), np.random.default_rng(0).uniform(-1, 1, _ROWS)
    for t in range(_ROWS - 1):
        x[t + 1] = 0.8 * x[t] + 0.3 * u[t] + 0.01 * np.sin(t)
    return {"x": x, "u": u}


def _data(model: Model, frame: dict[str, np.ndarray]) -> Dataset:
    """The frame as a dataset with the sets of the spec."""
    return measured(model, frame, None, "training")


def killed(subject: Subject, folder: Path, seed: int) -> Outcome:
    """Kills a command at a random moment, possibly again after it is resumed, then lets it
    finish.
    """
    random = Random(seed)  # noqa: S311  (repeatable, no secret)
    folder.mkdir()
    has_before = subject.kind == "export" and random.random() < 0.5
    if has_before:
        subject.exported_before(folder)
    earlier = _left(subject.kind, folder)
    kills, lost, whole, stayed, told = 0, 0.0, True, True, False
    for _ in range(random.choice((1, 1, 2, 3))):
        number = random.choice(_SIGNALS)
        began = time.time()
        process = _started(subject.run, folder, _is_unfinished(folder))
        time.sleep(random.uniform(0.0, subject.seconds))
        moment = time.time()
        with suppress(ProcessLookupError):
            os.kill(process, number)
        code = _wait(process)
        if code == 0:
            break  # it was over before
        if code == _MISTAKE:  # nobody killed that
            whole = False
            break
        kills += 1
        if subject.kind == "export":
            whole &= _is_whole(_left("export", folder), earlier, subject.left)
        else:
            lost = max(lost, _lost(folder, began, moment))
            told |= number != signal.SIGKILL  # whoever is told how to go on has the weights, too
            stayed &= told or not _leads_to_unfinished(folder, subject.left)
    ended = _wait(_started(subject.run, folder, _is_unfinished(folder))) == 0
    right = ended and whole and _left(subject.kind, folder) == subject.left
    return Outcome(subject.kind, kills, lost, right, stayed)


def _started(run: Callable[[Path, bool], None], folder: Path, resume: bool) -> int:
    """Starts the command in a fork of this process, which has loaded all modules; returns its
    number.
    """
    process = os.fork()
    if process:
        return process
    code = _MISTAKE
    try:
        interrupt_on_signals()
        run(folder, resume)
        code = 0
    except BaseException as error:  # noqa: BLE001  (whatever ends it)
        if isinstance(error, TrainingInterruptedError) or is_interrupt(error):
            code = _STOPPED
        (folder / "error.txt").write_text(repr(error))
    finally:
        os._exit(code)


def _wait(process: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def _is_unfinished(folder: Path) -> bool:
    return next(folder.rglob(CHECKPOINT), None) is not None


def _leads_to_unfinished(folder: Path, left: Mapping[str, bytes]) -> bool:
    """True if `latest` points to a run that has not written its last weights.

    A run with them keeps its last checkpoint until its standard errors are known.
    """
    latest = folder / "runs" / "gain" / "latest"
    checkpoint = latest / CHECKPOINT
    if not checkpoint.is_file() or read_checkpoint(checkpoint).place is None:
        return False
    return (latest / WEIGHTS).read_bytes() not in left.values()


def _lost(folder: Path, began: float, moment: float) -> float:
    """Seconds between the last checkpoint, or the begin of the run or fold, and the kill.

    What a process that was killed before had lost is not lost again: `began` is this one's begin.
    """
    kept = [*folder.rglob(CHECKPOINT), *folder.rglob(DESCRIPTION)]
    last = max((path.stat().st_mtime for path in kept), default=moment)
    return max(0.0, moment - max(last, began))


def _left(kind: Kind, folder: Path) -> dict[str, bytes]:
    """The contents of the files that must be right, without the times in them."""
    if kind == "export":
        paths = [path for name in ("c", "onnx") for path in (folder / name).rglob("*")]
        return {str(p.relative_to(folder)): p.read_bytes() for p in paths if p.is_file()}
    runs = [path.parent for path in folder.rglob(DESCRIPTION) if (path.parent / WEIGHTS).is_file()]
    found: dict[str, bytes] = {}
    newest = {run.name if run.name.startswith("fold") else "run": run for run in sorted(runs)}
    for name, run in newest.items():
        if run.parent.name == "latest" or run.name == "latest":
            continue
        found[f"{name} weights"] = (run / WEIGHTS).read_bytes()
        found[f"{name} epochs"] = _epochs(run / METRICS)
        found[f"{name} parameters"] = _bytes(run / "parameters.json")
    return found


def _bytes(file: Path) -> bytes:
    return file.read_bytes() if file.is_file() else b""


def _epochs(metrics: Path) -> bytes:
    lines: list[object] = []
    for line in _bytes(metrics).splitlines():
        with suppress(ValueError):
            lines.append({**json.loads(line), "seconds": None})
    return json.dumps(lines).encode()


def _is_whole(left: dict[str, bytes], earlier: dict[str, bytes], new: dict[str, bytes]) -> bool:
    """True if every target has either all its old files or all its new ones."""
    for target in ("c", "onnx"):
        found, *whole = (_of(target, files) for files in (left, earlier, new))
        if found not in whole:
            return False
    return True


def _of(target: str, files: dict[str, bytes]) -> dict[str, bytes]:
    return {name: content for name, content in files.items() if name.startswith(target)}
