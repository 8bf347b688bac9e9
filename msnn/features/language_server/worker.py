"""Runs checks in a separate process, which can be killed without affecting the server."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing import get_context
from typing import Any

from msnn.features.language_server.examine import Examined, examine
from msnn.project.process_context import children_off_working_folder

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
        """See `examine.examine`; CheckEndedError if `gives_up` returns True or the process dies."""
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
        """Kills the process."""
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
    """Checks received texts until the pipe is closed."""
    os.dup2(2, 1)  # the standard output is the editor's
    with suppress(EOFError, OSError):  # the server is gone
        while True:
            pipe.send(_answered(*pipe.recv()))


def _answered(path: str, text: str, unsaved: Mapping[str, str]) -> Examined | str:
    try:
        return examine(path, text, unsaved)
    except Exception as error:  # noqa: BLE001  (a mistake of ours ends one check, not all)
        return f"msnn met a mistake of its own ({type(error).__name__}: {error})"
