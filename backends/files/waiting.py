"""Waits for another process, and not for ever: neither past a limit nor past Ctrl-C."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType

GRACE = 5.0
"""Seconds that are waited on when Ctrl-C is heard by somebody who goes on for now."""

_SHORTEST, _LONGEST = 0.001, 0.05
"""Seconds between two looks."""


def wait_until(done: Callable[[], bool], limit: float) -> bool:
    """Looks until `done` or the limit in seconds is reached; whether it is done.

    A training takes the first Ctrl-C as a wish to end after the batch. While it waits here there is
    no batch: KeyboardInterrupt is raised a few seconds later, which leaves a compiler that works
    the time to end.
    """
    with _heard_interrupts() as heard:
        began, pause = time.monotonic(), _SHORTEST
        while not done():
            now = time.monotonic()
            if heard and now - heard[0] > GRACE:
                raise KeyboardInterrupt
            if now - began > limit:
                return False
            time.sleep(pause)
            pause = min(2.0 * pause, _LONGEST)
    return True


@contextmanager
def _heard_interrupts() -> Generator[list[float]]:
    """Records when interrupts come; whoever handled them before still does."""
    heard: list[float] = []
    # Python lets no other thread set handlers
    if threading.current_thread() is not threading.main_thread():
        yield heard
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def hear(number: int, frame: FrameType | None) -> None:
        heard.append(time.monotonic())
        handler = before[signal.Signals(number)]
        if callable(handler):
            handler(number, frame)

    # SIG_DFL and SIG_IGN are no functions: what the system does by itself stays as it is
    handled = {number: handler for number, handler in before.items() if callable(handler)}
    for number in handled:
        signal.signal(number, hear)
    try:
        yield heard
    finally:
        for number, handler in handled.items():
            signal.signal(number, handler)
