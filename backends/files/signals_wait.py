"""Lets Ctrl-C and SIGTERM wait for a moment in which they would leave half of something."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def signals_wait() -> Generator[None]:
    """Handles a signal that comes meanwhile when all is done; only the main thread hears any."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        del frame
        came.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        # with all handlers back: the first signal may raise, and ours must not stay then
        for number in came:
            signal.raise_signal(number)
