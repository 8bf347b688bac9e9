"""Runs the trials of a comparison as tasks of a Ray cluster, and keeps here what they leave."""

from __future__ import annotations

import json
import logging
import tempfile
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from backends.files.atomic_write import write_bytes, write_text
from msnn.comparison.readings import Latest, Readings
from msnn.comparison.trial import (
    Outcome,
    ReadyTrial,
    Setup,
    Trial,
    killed,
    ready_trial,
    refused,
    train_ready,
    trial_folder,
)
from msnn.comparison.waiting import Waiting
from msnn.errors.sweeps import unusable_cluster
from msnn.model.kept_run import CHECKPOINT, DESCRIPTION, PARTS, WEIGHTS, read_json, spec_places
from msnn.model.load import with_seed
from msnn.model.model import Model
from msnn.packages import RAY
from msnn.training.folds import of_fold
from msnn.training.records.run_log import RunLine
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.version import __version__

_AHEAD = 3
"""Tasks for each processor that have begun or wait for it: no node is idle while one is made."""
_RETRIES, _TIMES = 3, "four times"
"""After the worker or the node of a task was killed."""
_STORED = 64
"""Models and data in the object store, of those that were sent last."""
_OPEN_MODELS, _OPEN_DATA = 4, 16
"""That a process of a node keeps: folds and variants after each other share them."""

Files = Mapping[str, bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A trial as it is sent: what others share with it is named, and lies in the object store."""

    trial: Trial
    line: RunLine
    model: Any
    """The reference of the model before its fold and seed."""
    rows: Any
    """That of the data without their series: which rows are whose."""
    series: Any
    spec: str
    spec_places: Sequence[str]
    """Where the spec is, seen from the folder that the command will write."""
    setup: Setup


def ray_outcomes(
    waiting: Waiting, setup: Setup, known: Mapping[str, RunLine], address: str
) -> Generator[tuple[Trial, Outcome]]:
    """Each trial with its outcome, as they end, trained on the cluster at `address`.

    Specs and data are read here, so that nodes need neither; series go into the object store once.
    A trial whose worker or node is killed begins again on another. What trainings leave comes back
    and is written below `setup.runs`. Raises SpecError where there is no such cluster.
    """
    with _Cluster(address, setup) as cluster:
        readings, trial = Readings(setup.data, setup.data_root), None
        while True:
            while cluster.has_room and (trial := waiting.take(trial)) is not None:
                ready = ready_trial(trial, setup, known, readings)
                if isinstance(ready, Outcome):
                    yield trial, ready
                else:
                    cluster.start(ready, readings.model(trial.variant, None))
            if not cluster.busy:
                break
            yield from cluster.ended()


@dataclass(slots=True)
class _Cluster:
    """A connection to Ray, and the tasks that are under way."""

    address: str
    setup: Setup
    _ray: Any = field(init=False, default=None)
    _is_ours: bool = field(init=False, default=False)
    _task: Any = field(init=False, default=None)
    _most: int = field(init=False, default=0)
    _running: dict[Any, ReadyTrial] = field(init=False, default_factory=dict[Any, ReadyTrial])
    _stored: Latest[tuple[object, Any]] = field(
        init=False, default_factory=lambda: Latest[tuple[object, Any]](_STORED)
    )

    def __enter__(self) -> _Cluster:
        RAY.require("trains on a cluster")
        ray = self._ray = import_module("ray")
        # a connection that the caller opened is the caller's to close
        self._is_ours = not ray.is_initialized()
        if self._is_ours:
            try:
                ray.init(self.address, log_to_driver=False, logging_level=logging.ERROR)
            except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
                why = str(error).strip().splitlines() or [type(error).__name__]
                raise SpecError((unusable_cluster(self.address, why[0]),)) from error
        cores = int(ray.cluster_resources().get("CPU", 1))
        self._most = max(1, cores) * _AHEAD
        self._task = ray.remote(
            max_retries=_RETRIES,
            retry_exceptions=[OSError],  # what a task sees of its node that is killed
            num_cpus=1,
        )(_in_task)
        return self

    def __exit__(self, *why: object) -> None:
        for task in self._running:
            with suppress(Exception):  # a cluster that is gone runs nothing
                self._ray.cancel(task, force=True)
        if self._is_ours and self._ray is not None:
            self._ray.shutdown()

    @property
    def busy(self) -> bool:
        return bool(self._running)

    @property
    def has_room(self) -> bool:
        return len(self._running) < self._most

    def start(self, ready: ReadyTrial, shared: Model) -> None:
        """Sends what a node cannot read: the model, which rows are whose, where series are."""
        # paths of this machine mean nothing on a node; weights of sub-models are in the program
        # already
        data, spec, runs = ready.data, str(ready.model.path), self.setup.runs
        folder = None if runs is None else runs / trial_folder(ready.model, ready.line)

        def bare() -> Model:
            parts = tuple(replace(part, file=None) for part in shared.parts)
            return replace(shared, parts=parts)

        task = Task(
            trial=ready.trial,
            line=replace(ready.line, version=__version__),
            model=self._reference(shared, bare),
            rows=self._reference(data, lambda: replace(data, series={})),
            series=self._reference(data.series, lambda: data.series),
            spec=spec,
            spec_places=[] if folder is None else spec_places(spec, folder),
            setup=replace(self.setup, data=None, data_root=None),
        )
        self._running[self._task.remote(task)] = ready

    def _reference(self, value: object, sent: Callable[[], object]) -> Any:
        """The reference of a value in the object store, where it lies once."""
        stored = self._stored.get(id(value), lambda: (value, self._ray.put(sent())))
        return stored[1]  # the value stays, and so does its identity

    def ended(self) -> list[tuple[Trial, Outcome]]:
        """Trials that are over, at least one, with their files written here."""
        done, _ = self._ray.wait(list(self._running), num_returns=1)
        return [self._result(task, self._running.pop(task)) for task in done]

    def _result(self, task: Any, ready: ReadyTrial) -> tuple[Trial, Outcome]:
        exceptions = self._ray.exceptions
        try:
            outcome, files = self._ray.get(task)
        except (
            exceptions.WorkerCrashedError,
            exceptions.NodeDiedError,
            exceptions.OutOfMemoryError,
            exceptions.LocalRayletDiedError,
        ):
            return ready.trial, killed(ready.trial, _TIMES)
        # other versions may train otherwise, and the log would hold both under one key
        if outcome.line.version not in ("", __version__):
            why = f"a node has msnn {outcome.line.version}, and this is {__version__}"
            return ready.trial, refused(
                ready.line, SpecError((unusable_cluster(self.address, why),))
            )
        self._keep(ready, outcome.line, files)
        return ready.trial, outcome

    def _keep(self, ready: ReadyTrial, line: RunLine, files: Files) -> None:
        if self.setup.runs is None or line.folder is None:
            return
        folder = self.setup.runs / line.folder
        for name, content in files.items():
            # who finds the line in the log and no weights trains again
            write_bytes(folder / name, content, durable=name == WEIGHTS, named_later=True)
        for part in ready.model.parts:
            if part.file is not None:
                place = folder / PARTS / f"{part.name}.safetensors"
                write_bytes(place, part.file.read_bytes())


def _in_task(task: Task) -> tuple[Outcome, Files]:
    """Trains on a node, in a folder of its own; what it leaves is the answer."""
    trial = task.trial
    model = with_seed(_opened(task.model, _MODELS), trial.seed)
    model = model if trial.fold is None else of_fold(model, trial.fold)
    data = replace(_opened(task.rows, _DATA), series=_opened(task.series, _DATA))
    ready = ReadyTrial(trial, task.line, model, data)
    with tempfile.TemporaryDirectory(prefix="msnn-") as place:
        runs = None if task.setup.runs is None else Path(place)
        outcome = train_ready(ready, replace(task.setup, runs=runs))
        files: dict[str, bytes] = {}
        if runs is not None and outcome.line.folder is not None:
            folder = runs / outcome.line.folder
            record = read_json(folder / DESCRIPTION)
            record |= {"spec": task.spec, "spec_places": task.spec_places}  # as the command sees it
            text = json.dumps(record, ensure_ascii=False, indent=2) + "\n"
            write_text(folder / DESCRIPTION, text)
            files = {
                path.relative_to(folder).as_posix(): path.read_bytes()
                for path in folder.rglob("*")
                # the training is over: nobody goes on from there
                if path.is_file() and path.name != CHECKPOINT
            }
    return outcome, files


_MODELS = Latest[Any](_OPEN_MODELS)
_DATA = Latest[Any](_OPEN_DATA)


def _opened(reference: Any, kept: Latest[Any]) -> Any:
    """What lies in the object store, the same object each time as long as it is kept."""
    return kept.get(reference.hex(), lambda: import_module("ray").get(reference))
