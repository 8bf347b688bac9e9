"""Ends a training at Ctrl-C or SIGTERM after the current batch, so that it can be resumed."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def end_on_interrupt(*, second_kills: bool = True) -> Generator[threading.Event]:
    """Sets the event at the first Ctrl-C or SIGTERM; the second one kills the process.

    torchrun forwards signals that its processes have already received. There the second signal is a
    repetition of the first.
    """
    asked = threading.Event()
    # Python hands signals to the main thread alone and refuses handlers elsewhere
    if threading.current_thread() is not threading.main_thread():
        yield asked
        return

    def ask(number: int, frame: FrameType | None) -> None:
        del number, frame
        if asked.is_set() and second_kills:
            raise KeyboardInterrupt
        asked.set()

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
