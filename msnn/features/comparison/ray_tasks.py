"""Trains trials on a node of a Ray cluster, and returns their files."""

from __future__ import annotations

import gc
import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from msnn.features.comparison.readings import Latest
from msnn.features.comparison.trial import ReadyTrial, Setup, Trial, TrialOutcome, train_ready
from msnn.model.load import with_seed
from msnn.model.saved_run import CHECKPOINT, DESCRIPTION, read_json
from msnn.project.imports import load_away_from_folder
from msnn.training.folds import of_fold
from msnn.training.records.run_log import RunLine
from spec_schema.version import __version__

_OPEN_MODELS, _OPEN_DATA = 4, 16
"""Cache sizes of a node's process: successive folds and variants share models and data."""

Files = Mapping[str, bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class SentTrial:
    """A trial as it is sent to a node; `rows` and `series` are references to Ray's object store."""

    trial: Trial
    line: RunLine
    rows: Any
    """Reference to the dataset without series: sets and recordings of its rows."""
    series: Any
    spec_places: Sequence[str]
    """Paths of the spec relative to the run's folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Several trials that a node trains one after the other; they share the model and, as a rule,
    the data.
    """

    trials: tuple[SentTrial, ...]
    model: Any
    """Reference to the model before applying folds and seeds."""
    spec: str
    setup: Setup


@dataclass(frozen=True, slots=True)
class TaskResult:
    """The outcome of a trial on a node, the contents of its files by path in the run's folder, and
    its duration in seconds.
    """

    outcome: TrialOutcome
    files: Files
    seconds: float


def in_task(task: Task) -> list[TaskResult]:
    """Trains the trials of a task on a node, each in a temporary folder; returns outcomes and
    files.
    """
    load_away_from_folder()
    found = [_trained(task, sent) for sent in task.trials]
    _freeze()
    return found


@cache
def _freeze() -> None:
    """Excludes imported objects from garbage collection, once per process."""
    gc.freeze()


def _trained(task: Task, sent: SentTrial) -> TaskResult:
    began, trial = time.monotonic(), sent.trial
    model = with_seed(_opened(task.model, _MODELS), trial.seed)
    model = model if trial.fold is None else of_fold(model, trial.fold)
    # arrays from the object store are read-only and shared by all processes of a node
    data = replace(_opened(sent.rows, _DATA), series=_opened(sent.series, _DATA))
    ready = ReadyTrial(trial, sent.line, model, data)
    # nodes share no disk with the command, as a rule
    with tempfile.TemporaryDirectory(prefix="msnn-") as place:
        runs = None if task.setup.runs is None else Path(place)
        outcome = train_ready(ready, replace(task.setup, runs=runs))
        files: dict[str, bytes] = {}
        if runs is not None and outcome.line.folder is not None:
            folder = runs / outcome.line.folder
            files = {
                path.relative_to(folder).as_posix(): path.read_bytes()
                for path in folder.rglob("*")
                # the training is over: nobody goes on from there
                if path.is_file() and path.name != CHECKPOINT
            }
            record = read_json(folder / DESCRIPTION)
            record |= {"spec": task.spec, "spec_places": sent.spec_places}  # as the command sees it
            text = json.dumps(record, ensure_ascii=False, indent=2) + "\n"
            files[DESCRIPTION] = text.encode()
    # what has trained: the line came with the version of the command
    line = replace(outcome.line, version=__version__)
    return TaskResult(replace(outcome, line=line), files, time.monotonic() - began)


_MODELS = Latest[Any](_OPEN_MODELS)
_DATA = Latest[Any](_OPEN_DATA)


def _opened(reference: Any, kept: Latest[Any]) -> Any:
    """The object that a reference to Ray's object store means; `kept` caches it, so that a node's
    process has it once.
    """
    # get() would make a new object each time, and the caches of the model with it
    return kept.get(reference.hex(), lambda: import_module("ray").get(reference))
