"""Shows the progress of a simulation."""

from __future__ import annotations

import time
from types import TracebackType
from typing import TextIO

from msnn.terminals import is_live

_FIRST = 1.0
"""Seconds before the first message; most simulations are shorter."""

_AGAIN = 0.1, 5.0
"""Seconds between two messages, on a terminal and elsewhere."""


class StepProgress:
    """Progress lines; on a terminal one line that is rewritten, and cleared at the end."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._live = stream, is_live(stream)
        self._began: tuple[float, int] | None = None
        """Time of the first call and its number of steps."""
        self._next = 0.0
        self._said = False

    def told(self, done: int, total: int) -> None:
        """Receives the number of completed steps and the total."""
        now = time.monotonic()
        if self._began is None:
            self._began, self._next = (now, done), now + _FIRST
        # at the end the result says it; a line "0 s left" above it would only stay there
        began, before = self._began
        # another simulation begins with fewer steps: of no step since there is no time to tell
        if now < self._next or done >= total or done <= before:
            return
        self._next = now + _AGAIN[0 if self._live else 1]
        # linear in the steps since the first call: what was done before, loading and compiling,
        # counts not
        left = (now - began) / (done - before) * (total - done)
        text = f"  {done:,} of {total:,} steps, {left:.0f} s left"
        # ECMA-48 EL 2 clears the whole line: a shorter text would leave the end of the longer one
        self._stream.write(f"\r\x1b[2K{text}" if self._live else f"{text}\n")
        self._stream.flush()
        self._said = True

    def __enter__(self) -> StepProgress:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._said and self._live:
            self._stream.write("\r\x1b[2K")
            self._stream.flush()
