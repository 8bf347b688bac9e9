"""Schedules checks of open texts, runs them in a separate process, and stores their results."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from typing import Any

from msnn.features.language_server.knowledge import Examined, Knowledge, examine
from msnn.features.language_server.problems import Problem, problems_of
from msnn.features.language_server.view import View
from msnn.project.process_context import children_off_working_folder
from spec_schema.diagnostics.source import SourceText

PAUSE = 0.15
"""Seconds without a change before a text is checked."""
_STALE = 2.0
"""Seconds after which a check of an outdated text is cancelled."""
_LONGEST = 60.0
"""Timeout of a check in seconds."""


@dataclass(eq=False, kw_only=True)
class OpenText:
    """A text in an editor, and the results of its last check, which may be of an older version."""

    path: str
    source: SourceText
    version: int | None = None
    due: float | None = None
    """Time of the next check; None if the current text was checked."""
    checked: SourceText | None = None
    """The text to which `problems` belong."""
    problems: tuple[Problem, ...] = ()
    files: frozenset[str] = frozenset()
    """Real paths of the files that the last check read."""
    knowledge: Knowledge = field(default_factory=Knowledge)
    _view: View | None = None

    @property
    def view(self) -> View:
        """The current text with the names known from the last compiled model; cached until one of
        them changes.
        """
        view = self._view
        if view is None or view.source is not self.source or view.knowledge is not self.knowledge:
            view = self._view = View(self.source, self.knowledge)
        return view


class Checks:
    """The open texts by URI, and one process that checks them in turn.

    `publish` is called with URI and text after each check, `complain` with a message for the user
    if a check fails.
    """

    def __init__(
        self, publish: Callable[[str, OpenText], None], complain: Callable[[str], None]
    ) -> None:
        self.texts: dict[str, OpenText] = {}
        self._publish, self._complain = publish, complain
        self._process = CheckProcess()
        # one: texts are checked in turn by one process, and its pipe knows one question at a time
        self._thread = ThreadPoolExecutor(max_workers=1)
        self._is_over = False
        self._changed = asyncio.Event()

    def put(self, address: str, path: str, text: str, version: int | None) -> None:
        """Opens or replaces the text with the URI `address`; schedules checks of it and of the
        texts that use its file. `path` is that of the file, `version` the editor's number of the
        text.
        """
        opened, pause = self.texts.get(address), PAUSE
        if opened is None:
            pause = 0.0
            opened = self.texts[address] = OpenText(path=path, source=SourceText(path, text))
        # A byte order mark is not a character of the text.
        opened.source = SourceText(path, text.removeprefix("\ufeff"))
        opened.version = version
        self._ask(opened, time.monotonic() + pause)

    def close(self, address: str) -> None:
        """Removes the text with the URI `address`; texts that use its file are checked again, with
        the saved file.
        """
        # before asking: those that use it read its file then, not what was typed
        closed = self.texts.pop(address, None)
        if closed is not None:
            self._ask(closed, time.monotonic())

    def look_again(self) -> None:
        """Schedules checks of all texts, because files may have changed."""
        for opened in self.texts.values():
            opened.due = time.monotonic()
        self._changed.set()

    def end(self) -> None:
        """Kills the process that checks texts, and ends `run`."""
        self._is_over = True
        self._thread.shutdown(wait=True, cancel_futures=True)
        self._process.stop()

    async def run(self) -> None:
        """Runs scheduled checks one after the other until `end` is called. Errors of a check are
        reported to `complain`.
        """
        loop = asyncio.get_running_loop()
        # while the editor still shows the file: the first check then finds a process ready
        loop.run_in_executor(self._thread, self._process.start)
        while not self._is_over:
            waiting = [(t.due, address) for address, t in self.texts.items() if t.due is not None]
            if not waiting:
                # cleared before waiting, by the only task that waits: a change in between is not
                # lost
                self._changed.clear()
                await self._changed.wait()
                continue
            # the one that waits longest; a change puts its own text off again
            due, address = min(waiting)
            if due > time.monotonic():
                await asyncio.sleep(due - time.monotonic())
                continue
            try:
                await self._check(address, self.texts[address], loop)
            except Exception as error:  # noqa: BLE001  (a mistake of ours ends one check, not all)
                self._complain(f"{address}: {type(error).__name__}: {error}")

    async def _check(self, address: str, opened: OpenText, loop: asyncio.AbstractEventLoop) -> None:
        # before the check, so that a change meanwhile asks for another one
        source, opened.due = opened.source, None
        unsaved = {_real(t.path): t.source.text for a, t in self.texts.items() if a != address}
        gives_up = partial(self._gives_up, opened, source, time.monotonic())
        check = partial(self._process.examine, opened.path, source.text, unsaved, gives_up)
        try:
            examined = await loop.run_in_executor(self._thread, check)
        except CheckEndedError as error:
            if opened.source is source and not self._is_over:
                self._complain(f"{opened.path}: {error}")
            return
        self._take(opened, source, examined)
        # an answer about an older text would underline other words
        if self.texts.get(address) is opened and opened.source is source:
            self._publish(address, opened)

    def _take(self, opened: OpenText, source: SourceText, examined: Examined) -> None:
        opened.checked = source
        # kept also for a text that has changed since: repairs compare `checked` with `source`
        opened.problems = problems_of(examined, opened.path)
        # a text that cannot even be read leaves what was known of it: names are still proposed
        if examined.sources:
            opened.files = frozenset(map(_real, examined.sources))
        if examined.knowledge is not None:
            opened.knowledge = examined.knowledge

    def _gives_up(self, opened: OpenText, source: SourceText, began: float) -> bool:
        took = time.monotonic() - began
        is_stale = opened.source is not source and took > _STALE
        return self._is_over or is_stale or took > _LONGEST

    def _ask(self, changed: OpenText, due: float) -> None:
        """Schedules checks of a text at the time `due`, and of every open text whose last check
        read its file.
        """
        real = _real(changed.path)
        changed.due = due
        for opened in self.texts.values():
            if opened is not changed and real in opened.files:
                opened.due = due
        self._changed.set()


def _real(path: str) -> str:
    # realpath raises for a null byte, which an address may have
    return os.path.realpath(path) if "\0" not in path else path


_POLL = 0.05
"""Seconds between two tests if a check was cancelled."""


class CheckEndedError(Exception):
    """A check has no result: it was cancelled, or its process died."""


class CheckProcess:
    """A process that checks texts one after the other, and is restarted if it dies."""

    def __init__(self) -> None:
        # forked, it would share the editor's streams and locks of running threads
        self._context = get_context("spawn")
        self._process: Any = None
        self._pipe: Any = None

    def start(self) -> None:
        """Starts the process if it is not running; loading the compiler takes a second."""
        if self._process is not None and self._process.is_alive():
            return
        self.stop()
        self._pipe, theirs = self._context.Pipe()
        self._process = self._context.Process(target=_answer, args=(theirs,), daemon=True)
        with children_off_working_folder():
            self._process.start()
        # the process has the only other end: where it dies, reading here ends at once
        theirs.close()

    def examine(
        self,
        path: str,
        text: str,
        unsaved: Mapping[str, str],
        gives_up: Callable[[], bool],
    ) -> Examined:
        """Runs `examine` of `knowledge.py` in the process, which it starts if necessary.

        `gives_up` is called every `_POLL` seconds. Raises CheckEndedError if it returns True, if
        the process dies, or if msnn fails with an internal error.
        """
        try:
            self.start()
            self._pipe.send((path, text, dict(unsaved)))
            while not self._pipe.poll(_POLL):
                if gives_up():
                    self.stop()
                    raise CheckEndedError("given up")
            return self._result(self._pipe.recv())
        except (EOFError, OSError) as error:
            self.stop()
            raise CheckEndedError("the process that checks specs ended") from error

    def stop(self) -> None:
        """Kills the process and closes the pipe, if it runs."""
        if self._process is not None:
            # SIGKILL: a check that runs away in C code hears nothing else
            self._process.kill()
            self._process.join()
            self._pipe.close()
        self._process = self._pipe = None

    @staticmethod
    def _result(answer: Examined | str) -> Examined:
        # a text says what went wrong: exceptions of libraries need not survive pickling
        if isinstance(answer, str):
            raise CheckEndedError(answer)
        return answer


def _answer(pipe: Any) -> None:
    """Checks each text received from the pipe and sends the result, until the pipe is closed. Runs
    in the separate process.
    """
    os.dup2(2, 1)  # the standard output is the editor's
    with suppress(EOFError, OSError):  # the server is gone
        while True:
            pipe.send(_answered(*pipe.recv()))


def _answered(path: str, text: str, unsaved: Mapping[str, str]) -> Examined | str:
    try:
        return examine(path, text, unsaved)
    except Exception as error:  # noqa: BLE001  (a mistake of ours ends one check, not all)
        return f"msnn met a mistake of its own ({type(error).__name__}: {error})"
