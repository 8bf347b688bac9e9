"""Runs the trials of a comparison as Ray tasks, and saves their files locally."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import chdir, suppress
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any

from backends.files.atomic_write import write_bytes
from msnn.features.comparison.errors import unusable_cluster
from msnn.features.comparison.local_workers import Waiting
from msnn.features.comparison.ray_tasks import Files, SentTrial, Task, TaskResult, in_task
from msnn.features.comparison.readings import Latest, Readings
from msnn.features.comparison.trial import (
    ReadyTrial,
    Setup,
    Trial,
    TrialOutcome,
    killed,
    ready_trial,
    refused,
    trial_folder,
)
from msnn.model.model import Model
from msnn.model.saved_run import PARTS, WEIGHTS, spec_places
from msnn.packages import RAY
from msnn.project.package_names import HOME
from msnn.training.records.run_log import RunLine
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.version import __version__

_AHEAD = 3
"""Tasks per processor that are running or queued, so that no node is idle."""
_RETRIES, _TIMES = 3, "four times"
"""Retries after the worker or the node of a task was killed."""
_TOGETHER = 2.0
"""Seconds of training per task, because sending a task takes some milliseconds."""
_STORED = 64
"""Number of recent models and datasets kept in the object store."""


@dataclass(frozen=True, slots=True)
class Running:
    """A task that runs on a node, and its trials with model and data, in the same order."""

    task: Task
    ready: tuple[ReadyTrial, ...]

    @property
    def each(self) -> list[Running]:
        """Split into one task per trial, to repeat the trials of a killed task separately."""
        pairs = zip(self.task.trials, self.ready, strict=True)
        return [Running(replace(self.task, trials=(sent,)), (ready,)) for sent, ready in pairs]


def ray_outcomes(
    waiting: Waiting, setup: Setup, known: Mapping[str, RunLine], address: str
) -> Generator[tuple[Trial, TrialOutcome]]:
    """Yields each trial with its outcome when it ends, trained on the Ray cluster at `address`.

    Specs and data are read locally, so nodes need neither; series are sent to the object store
    once. A trial whose worker or node is killed restarts on another. Files of trainings are written
    below `setup.runs`. `known` are the logged lines by key. Raises SpecError if there is no such
    cluster, MissingExtraError without Ray.
    """
    with _Cluster(address, setup) as cluster:
        readings, last = Readings(setup.data, setup.data_root), None
        while True:
            # tasks are made as room comes: proposals know more by then, and little is lost by an
            # interrupt
            while cluster.has_room:
                taken = waiting.take_together(last, cluster.together(len(waiting)))
                if not taken:
                    break
                last, wanted = taken[-1], list[ReadyTrial]()
                for trial in taken:
                    ready = ready_trial(trial, setup, known, readings)
                    if isinstance(ready, TrialOutcome):
                        yield trial, ready
                    else:
                        wanted.append(ready)
                if wanted:
                    cluster.start(wanted, readings.model(last.variant, None))
            if not cluster.busy:
                break
            yield from cluster.ended()


@dataclass(slots=True)
class _Cluster:
    """A context with a connection to a Ray cluster; its exit cancels the tasks that still run."""

    address: str
    setup: Setup
    _ray: Any = field(init=False, default=None)
    _is_ours: bool = field(init=False, default=False)
    _task: Any = field(init=False, default=None)
    _cores: int = field(init=False, default=1)
    _seconds: float = field(init=False, default=_TOGETHER)
    """Duration of the longest training in the last completed task."""
    _running: dict[Any, Running] = field(init=False, default_factory=dict[Any, Running])
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
                # Ray lets all workers import from the folder in which it is started first: from
                # that of msnn they do anyway
                with chdir(HOME):
                    # its own lines would tear ours apart
                    ray.init(self.address, log_to_driver=False, logging_level=logging.ERROR)
            except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
                why = str(error).strip().splitlines() or [type(error).__name__]
                raise SpecError((unusable_cluster(self.address, why[0]),)) from error
        # of all nodes that have joined by now
        self._cores = max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._task = ray.remote(
            max_retries=_RETRIES,
            # what a task sees of its node that is killed
            retry_exceptions=[OSError, ray.exceptions.RayError],
            num_cpus=1,
        )(in_task)
        return self

    def __exit__(self, *why: object) -> None:
        for task in self._running:
            with suppress(Exception):  # a cluster that is gone runs nothing
                # force: a training listens to no exception while it is in a kernel
                self._ray.cancel(task, force=True)
        if self._is_ours and self._ray is not None:
            self._ray.shutdown()

    @property
    def busy(self) -> bool:
        return bool(self._running)

    @property
    def has_room(self) -> bool:
        return len(self._running) < self._cores * _AHEAD

    def together(self, waiting: int) -> int:
        """The number of trials for the next task, if `waiting` trials have not begun: about
        `_TOGETHER` seconds of training, but not so many that a processor is idle.
        """
        # at the end tasks become small, so that all processors end together
        return max(1, min(int(_TOGETHER / self._seconds), waiting // self._cores))

    def start(self, ready: Sequence[ReadyTrial], shared: Model) -> None:
        """Starts a task on a node that trains the trials `ready`, which share the model `shared`.
        Model, rows and series are stored once in the object store, and the task has references to
        them.
        """

        def bare() -> Model:
            # paths of this machine mean nothing on a node; weights of sub-models are in the program
            # already
            parts = tuple(replace(part, file=None) for part in shared.parts)
            return replace(shared, parts=parts)

        task = Task(
            trials=tuple(map(self._sent, ready)),
            model=self._reference(shared, bare),
            spec=str(shared.path),
            setup=replace(self.setup, data=None, data_root=None),
        )
        self._start(Running(task, tuple(ready)))

    def _start(self, running: Running) -> None:
        self._running[self._task.remote(running.task)] = running

    def _sent(self, ready: ReadyTrial) -> SentTrial:
        data, runs = ready.data, self.setup.runs
        folder = None if runs is None else runs / trial_folder(ready.model, ready.line)
        return SentTrial(
            trial=ready.trial,
            line=replace(ready.line, version=__version__),
            rows=self._reference(data, lambda: replace(data, series={})),
            series=self._reference(data.series, lambda: data.series),
            spec_places=[] if folder is None else spec_places(str(ready.model.path), folder),
        )

    def _reference(self, value: object, sent: Callable[[], object]) -> Any:
        """The reference of `value` in the object store. The first call for this object stores the
        result of `sent`, the form of it that nodes need.
        """
        stored = self._stored.get(id(value), lambda: (value, self._ray.put(sent())))
        return stored[1]  # the value stays, and so does its identity

    def ended(self) -> list[tuple[Trial, TrialOutcome]]:
        """Waits for a task to end; returns its trials with their outcomes, and writes their files
        locally.

        Empty for a task that was killed repeatedly: its trials restart separately, and a single
        trial is given up with an outcome. Errors of msnn on a node are raised.
        """
        (done,), _ = self._ray.wait(list(self._running), num_returns=1)
        running = self._running.pop(done)
        errors = self._ray.exceptions
        try:
            results: Sequence[TaskResult] = self._ray.get(done)
        except errors.RayError as error:
            # what a task raises comes as two in one: of Ray, and what it was
            if isinstance(error, errors.RayTaskError) and not isinstance(
                error.cause, OSError | errors.RayError
            ):
                raise
            if len(each := running.each) > 1:  # one of them may have killed all
                for alone in each:
                    self._start(alone)
                return []
            ready = running.ready[0]
            if isinstance(error, OSError):
                return [(ready.trial, self._refused(ready, f"a node: {error}".splitlines()[-1]))]
            return [(ready.trial, killed(ready.trial, _TIMES))]
        self._seconds = max(result.seconds for result in results)
        return [self._ended(*pair) for pair in zip(running.ready, results, strict=True)]

    def _ended(self, ready: ReadyTrial, result: TaskResult) -> tuple[Trial, TrialOutcome]:
        outcome = result.outcome
        # other versions may train otherwise, and the log would hold both under one key
        if outcome.line.version != __version__:
            why = f"a node has msnn {outcome.line.version}, and this is {__version__}"
            return ready.trial, self._refused(ready, why)
        self._keep(ready, outcome.line, result.files)
        return ready.trial, outcome

    def _refused(self, ready: ReadyTrial, why: str) -> TrialOutcome:
        return refused(ready.line, SpecError((unusable_cluster(self.address, why),)))

    def _keep(self, ready: ReadyTrial, line: RunLine, files: Files) -> None:
        if self.setup.runs is None or line.folder is None:
            return
        folder = self.setup.runs / line.folder
        for name, content in files.items():
            # who finds the line in the log and no weights trains again
            # fsync of the weights alone: dozens of small files a training would wait for the disk
            # each
            write_bytes(folder / name, content, durable=name == WEIGHTS, named_later=True)
        for part in ready.model.parts:
            if part.file is not None:
                place = folder / PARTS / f"{part.name}.safetensors"
                write_bytes(place, part.file.read_bytes())
