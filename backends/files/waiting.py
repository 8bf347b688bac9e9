"""Waits for another process, up to a time limit or Ctrl-C."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType

GRACE = 5.0
"""Seconds of further waiting after Ctrl-C, if the handler does not raise."""

_SHORTEST, _LONGEST = 0.001, 0.05
"""Seconds between two checks."""


def wait_until(done: Callable[[], bool], limit: float) -> bool:
    """Polls `done` until it is True, and returns True; False if the limit in seconds is reached
    before. During training, the first Ctrl-C means to stop after the batch. While waiting here
    there is no batch, so KeyboardInterrupt is raised a few seconds later. This leaves a compiler
    time to finish.
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
    """Context manager that gives a list, to which each SIGINT or SIGTERM adds its time
    (`time.monotonic`). Previous handlers are still called. The list stays empty outside the main
    thread.
    """
    heard: list[float] = []
    # only the main thread can set handlers
    if threading.current_thread() is not threading.main_thread():
        yield heard
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def hear(number: int, frame: FrameType | None) -> None:
        heard.append(time.monotonic())
        handler = before[signal.Signals(number)]
        if callable(handler):
            handler(number, frame)

    # SIG_DFL and SIG_IGN are not callable and stay unchanged
    handled = {number: handler for number, handler in before.items() if callable(handler)}
    for number in handled:
        signal.signal(number, hear)
    try:
        yield heard
    finally:
        for number, handler in handled.items():
            signal.signal(number, handler)
