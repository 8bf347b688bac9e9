"""Runs the trials of a comparison in separate worker processes."""

from __future__ import annotations

import gc
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from types import FrameType
from typing import Any, TypeAlias

from msnn.features.comparison.readings import Readings
from msnn.features.comparison.trial import Setup, Trial, TrialOutcome, killed, run_trial
from msnn.features.comparison.variants import Variant
from msnn.project.imports import load_away_from_folder
from msnn.project.process_context import process_context
from msnn.training.records.run_log import RunLine
from msnn.training.training_result import TrainingInterruptedError

_INTERRUPTED = 130
_TIMES = "twice"
"""How often a process is killed before its trial is given up, for messages."""


def outcomes(
    waiting: Waiting,
    setup: Setup,
    known: Mapping[str, RunLine],
    jobs: int,
    modules: Sequence[str] = (),
) -> Generator[tuple[Trial, TrialOutcome]]:
    """Yields each trial with its outcome when it ends; `jobs` run in parallel, a single one in this
    process.

    `known` are the logged lines by key. Workers import the slow `modules` before they begin, if the
    system can fork. A killed worker is replaced: its trial continues from its checkpoint after the
    others of its variant, and is given up when killed again. An interrupt ends all workers after
    the current batch. Raises TrainingInterruptedError if a training in this process is interrupted.
    """
    # no process of its own: a debugger and Ctrl-C work as in `train`
    if jobs == 1:
        readings, trial = Readings(setup.data, setup.data_root), None
        while (trial := waiting.take(trial)) is not None:
            yield trial, run_trial(trial, setup, known, readings)
        return
    again: set[Trial] = set()
    with _Workers(setup, known, jobs, modules) as workers:
        while workers.begin(waiting):
            for trial, outcome in workers.ended():
                if outcome is not None:
                    yield trial, outcome
                elif trial in again:
                    yield trial, killed(trial, _TIMES)
                else:
                    again.add(trial)
                    waiting.put_back(trial)


@dataclass(slots=True)
class _Shared:
    """The arguments that a worker process received at its start; None in other processes."""

    setup: Setup | None = None
    known: Mapping[str, RunLine] | None = None
    readings: Readings | None = None
    is_over: Any = None


_SHARED = _Shared()


@dataclass(slots=True)
class _Worker:
    """A worker process, which runs one trial at a time. `opened` makes the pool of this one
    process.
    """

    opened: Callable[[], ProcessPoolExecutor]
    last: Trial | None = None
    """The trial whose data it has loaded."""
    trial: Trial | None = None
    """The current trial."""
    future: Future[TrialOutcome] | None = None
    _pool: ProcessPoolExecutor | None = None

    def start(self, trial: Trial) -> None:
        """Starts a trial, in a new process if the old one was killed."""
        self.trial = self.last = trial
        if self._pool is not None:
            with suppress(BrokenProcessPool):
                self.future = self._pool.submit(_in_worker, trial)
                return
        self._pool = self.opened()
        self.future = self._pool.submit(_in_worker, trial)

    def ended(self) -> tuple[Trial, TrialOutcome | None]:
        """The trial that has ended, with its outcome; waits for it. The outcome is None if the
        process was killed.
        """
        assert self.trial is not None
        assert self.future is not None
        trial, future = self.trial, self.future
        self.trial = self.future = None
        try:
            return trial, future.result()
        except BrokenProcessPool:
            self.close()
            return trial, None

    def close(self) -> None:
        """Waits for the process to end; `start` makes a new one."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = self.last = None


class _Workers:
    """A context with `jobs` worker processes; an exception such as Ctrl-C interrupts all
    of them.
    """

    def __init__(
        self, setup: Setup, known: Mapping[str, RunLine], jobs: int, modules: Sequence[str]
    ) -> None:
        # this module too, with what it imports: a fork then starts to work at once
        context = process_context((__name__, *modules))
        self._began: Any = context.SimpleQueue()
        self._is_over: Any = context.Event()
        given = (self._began, self._is_over, setup, known, dict(os.environ))

        def opened() -> ProcessPoolExecutor:
            # a pool for each process: one that dies breaks its pool, and with a common one all
            # would be lost
            return ProcessPoolExecutor(1, context, initializer=_begin, initargs=given)

        self._all = [_Worker(opened) for _ in range(jobs)]

    def __enter__(self) -> _Workers:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is not None:
            self._interrupt()
        for worker in self._all:
            worker.close()

    def begin(self, waiting: Waiting) -> bool:
        """Assigns trials to idle workers; returns True if any trial is running."""
        for worker in self._all:
            if worker.trial is None and (trial := waiting.take(worker.last)) is not None:
                worker.start(trial)
        return any(worker.trial is not None for worker in self._all)

    def ended(self) -> list[tuple[Trial, TrialOutcome | None]]:
        """Waits for at least one trial to end; returns each ended trial with its outcome, None if
        its process was killed.
        """
        running = {worker.future: worker for worker in self._all if worker.future is not None}
        # whichever ends first: variants take different times
        done, _ = wait(running, return_when=FIRST_COMPLETED)
        return [running[future].ended() for future in done]

    def _interrupt(self) -> None:
        """Interrupts every worker: a signal to this process alone does not reach them."""
        # before the signals: a worker that takes a trial meanwhile sees it
        self._is_over.set()
        # each worker put its process there when it began
        while not self._began.empty():
            with suppress(ProcessLookupError):
                os.kill(self._began.get(), signal.SIGINT)


def _begin(
    began: Any,
    is_over: Any,
    setup: Setup,
    known: Mapping[str, RunLine],
    environment: Mapping[str, str],
) -> None:
    load_away_from_folder()
    os.environ.clear()  # that of a server is older, where one forked this process
    os.environ.update(environment)
    # modules never go: no search for garbage has to pass through all that they hold
    gc.freeze()
    _SHARED.setup, _SHARED.known, _SHARED.is_over = setup, known, is_over
    _SHARED.readings = Readings(setup.data, setup.data_root)
    for number in (signal.SIGINT, signal.SIGTERM):
        # between trainings; a training puts its own handler in place while it runs
        signal.signal(number, _end)
    began.put(os.getpid())


def _end(number: int, frame: FrameType | None) -> None:
    """Handles a signal in a worker between trainings: ends the process. A training has its own
    handler.
    """
    del number, frame
    # no clean-up: the interpreter would wait for threads of the pool
    os._exit(_INTERRUPTED)


def _in_worker(trial: Trial) -> TrialOutcome:
    assert _SHARED.setup is not None
    assert _SHARED.known is not None
    assert _SHARED.readings is not None
    if _SHARED.is_over.is_set():  # it began after the interrupt
        os._exit(_INTERRUPTED)
    try:
        return run_trial(trial, _SHARED.setup, _SHARED.known, _SHARED.readings)
    except (TrainingInterruptedError, KeyboardInterrupt):
        os._exit(_INTERRUPTED)  # its checkpoint is kept; the pool would wait for more to do


Group: TypeAlias = "tuple[Variant, int]"
"""The folds of a variant and seed, which share loaded data."""


def group_of(trial: Trial | None) -> Group | None:
    """The variant and seed of a trial; trials that share them should run in the same process, which
    has their data. None for None.
    """
    return None if trial is None else (trial.variant, trial.seed)


def nothing_more() -> Sequence[Trial]:
    """Returns no trials: the `more` of a queue whose trials are all known at the start."""
    return ()


class Waiting:
    """A queue of trials that have not begun. When it is empty, `more` returns further trials, or
    none.
    """

    def __init__(
        self, trials: Sequence[Trial], more: Callable[[], Sequence[Trial]] = nothing_more
    ) -> None:
        self._of: dict[Group, deque[Trial]] = {}
        self._begun: set[Group] = set()
        self._more = more
        self._add(trials)

    def __len__(self) -> int:
        """The number of known trials that have not begun."""
        return sum(map(len, self._of.values()))

    def take_together(self, last: Trial | None, most: int) -> list[Trial]:
        """Takes at most `most` trials of one group, starting as `take(last)` does; empty if that
        returns None.
        """
        found: list[Trial] = []
        while len(found) < most and (trial := self.take(found[-1] if found else last)) is not None:
            found.append(trial)
            # the group is used up: a task of two groups would read two sets of data
            if group_of(trial) not in self._of:
                break
        return found

    def take(self, last: Trial | None) -> Trial | None:
        """Takes the next trial for a worker whose previous trial was `last` (None for a new
        worker): from the same group, else from a group that no worker has begun, else from any.

        None if nothing remains, or if further proposals need a result first.
        """
        if not self._of:
            self._add(self._more())
        if not self._of:
            return None
        group = group_of(last)
        if group is None or group not in self._of:
            # a group of its own for each process as long as there are such; then helping one that
            # has begun
            fresh = (each for each in self._of if each not in self._begun)
            group = next(fresh, None) or next(iter(self._of))
        self._begun.add(group)
        found = self._of[group].popleft()
        if not self._of[group]:
            del self._of[group]
        return found

    def put_back(self, trial: Trial) -> None:
        """Returns a trial to the end of its group."""
        self._add((trial,))

    def _add(self, trials: Sequence[Trial]) -> None:
        for trial in trials:
            self._of.setdefault((trial.variant, trial.seed), deque()).append(trial)
