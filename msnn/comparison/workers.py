"""Runs the trials of a comparison in processes of their own, each ready for many."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from types import FrameType
from typing import Any

from msnn.comparison.readings import Readings
from msnn.comparison.trial import Outcome, Setup, Trial, killed, run_trial
from msnn.training.records.run_log import RunLine
from msnn.training.training_result import TrainingInterruptedError

_INTERRUPTED = 130
_TIMES = "twice"
"""That a process is killed before its trial is given up."""


def outcomes(
    trials: Sequence[Trial], setup: Setup, known: Mapping[str, RunLine], jobs: int
) -> Generator[tuple[Trial, Outcome]]:
    """Each trial with its outcome, as they end; `jobs` at once, one alone in this process.

    A process that is killed is replaced: its trial goes on from its checkpoint, alone, and is
    given up when it is killed again. An interrupt ends all of them after the batch that is on.
    """
    if jobs == 1 or len(trials) == 1:
        readings = Readings(setup.data, setup.data_root)
        for trial in trials:
            yield trial, run_trial(trial, setup, known, readings)
        return
    waiting = list(reversed(trials))
    suspects: list[Trial] = []
    while waiting or suspects:
        alone = bool(suspects)
        batch = [suspects.pop()] if alone else waiting
        with _Workers(setup, known, 1 if alone else jobs) as workers:
            while workers.busy or (batch and not workers.broken):
                # handed out one by one: what stands in the queue of a pool that breaks would count
                # as killed too
                while batch and workers.has_room and workers.start(batch[-1]):
                    batch.pop()
                for trial, outcome in workers.ended() if workers.busy else ():
                    if outcome is not None:
                        yield trial, outcome
                    elif alone:
                        yield trial, killed(trial, _TIMES)
                    else:  # which of those that ran together was killed, nobody knows
                        suspects.append(trial)
        if alone:
            # what ran alone and did not begin, as another was killed meanwhile, is tried alone
            # again
            suspects += batch


@dataclass(slots=True)
class _Shared:
    """What a worker was given when it began."""

    setup: Setup | None = None
    known: Mapping[str, RunLine] | None = None
    readings: Readings | None = None
    is_over: Any = None


_SHARED = _Shared()


class _Workers:
    """So many processes, started afresh: nothing of this one is in them but what they are given."""

    def __init__(self, setup: Setup, known: Mapping[str, RunLine], jobs: int) -> None:
        # forked processes would share threads' locks of numpy and torch in the state of the moment
        context = get_context("spawn")
        self._began: Any = context.SimpleQueue()
        self._is_over: Any = context.Event()
        self._jobs = jobs
        self.broken = False
        """Whether one was killed: the others have ended with it."""
        self._running: dict[Future[Outcome], Trial] = {}
        self._pool = ProcessPoolExecutor(
            jobs, context, initializer=_begin, initargs=(self._began, self._is_over, setup, known)
        )

    def __enter__(self) -> _Workers:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is not None:
            self._interrupt()
        self._pool.shutdown(wait=True, cancel_futures=True)

    @property
    def busy(self) -> bool:
        return bool(self._running)

    @property
    def has_room(self) -> bool:
        return len(self._running) < self._jobs and not self.broken

    def start(self, trial: Trial) -> bool:
        """Whether it has begun: one that ran may have been killed since the last look."""
        try:
            self._running[self._pool.submit(_in_worker, trial)] = trial
        except BrokenProcessPool:
            self.broken = True
        return not self.broken

    def ended(self) -> list[tuple[Trial, Outcome | None]]:
        """Trials that are over, at least one; None where their process was killed."""
        done, _ = wait(self._running, return_when=FIRST_COMPLETED)
        if any(isinstance(future.exception(), BrokenProcessPool) for future in done):
            self.broken = True
            # one killed process breaks the whole pool: the other futures fail within moments, and
            # are collected here
            done, _ = wait(self._running)
        return [(self._running.pop(future), _outcome(future)) for future in done]

    def _interrupt(self) -> None:
        """Asks every worker to end: of a Ctrl-C in a terminal they know, of others they do not."""
        self._is_over.set()
        while not self._began.empty():
            with suppress(ProcessLookupError):
                os.kill(self._began.get(), signal.SIGINT)


def _outcome(future: Future[Outcome]) -> Outcome | None:
    try:
        return future.result()
    except BrokenProcessPool:
        return None


def _begin(began: Any, is_over: Any, setup: Setup, known: Mapping[str, RunLine]) -> None:
    _SHARED.setup, _SHARED.known, _SHARED.is_over = setup, known, is_over
    _SHARED.readings = Readings(setup.data, setup.data_root)
    for number in (signal.SIGINT, signal.SIGTERM):
        # between trainings; a training puts its own handler in place while it runs
        signal.signal(number, _end)
    began.put(os.getpid())


def _end(number: int, frame: FrameType | None) -> None:
    """Between trainings there is nothing to keep; a training listens by itself."""
    del number, frame
    os._exit(_INTERRUPTED)


def _in_worker(trial: Trial) -> Outcome:
    assert _SHARED.setup is not None
    assert _SHARED.known is not None
    assert _SHARED.readings is not None
    if _SHARED.is_over.is_set():  # it began after the interrupt
        os._exit(_INTERRUPTED)
    try:
        return run_trial(trial, _SHARED.setup, _SHARED.known, _SHARED.readings)
    except (TrainingInterruptedError, KeyboardInterrupt):
        os._exit(_INTERRUPTED)  # its checkpoint is kept; the pool would wait for more to do
