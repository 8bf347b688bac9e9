"""Selects the receiver of training progress: a terminal, a notebook, a function, or none."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from html import escape
from importlib import import_module
from typing import Any, TypeAlias

from msnn.tables import is_live
from msnn.training.records.progress import (
    EpochEnd,
    Lines,
    Progress,
    Silent,
    StageEnd,
    StageStart,
    end_text,
    epoch_text,
    stage_text,
)
from spec_schema.diagnostics.diagnostic import Diagnostic, describe

Event: TypeAlias = StageStart | EpochEnd | StageEnd | Diagnostic
Hearer: TypeAlias = Progress | Callable[[Event], object] | bool | None
"""None shows lines in terminals and notebooks; True shows them always, False never."""

_AGAIN = 0.2
"""Minimum seconds between two updates in a notebook."""


def heard_by(hearer: Hearer) -> Progress:
    """The receiver of progress for the argument `progress` of `train`: a terminal, notebook or
    function.
    """
    if hearer is None or isinstance(hearer, bool):
        # a notebook's stderr is no terminal, and carriage returns pile up there
        if hearer is not False and in_notebook():
            return NotebookLines()
        # stdout is for what a program prints
        live = is_live(sys.stderr)
        shown = live if hearer is None else hearer
        return Lines(sys.stderr, terminal=live) if shown else Silent()
    # said before data are read, which may take minutes
    if not callable(hearer) and not hasattr(hearer, "epoch_ended"):
        wanted = "None, True, False, a function, or an object that hears of epochs"
        raise TypeError(f"progress is {type(hearer).__name__}; it may be {wanted}")
    return Called(hearer) if callable(hearer) else hearer


def in_notebook() -> bool:
    """True in a Jupyter kernel; IPython in a terminal counts as a terminal."""
    # looked for, not imported: a script need not wait for it
    shell: Any = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return shell is not None and hasattr(shell, "kernel")


class Called:
    """A receiver of progress that passes every event to one function."""

    def __init__(self, hear: Callable[[Event], object]) -> None:
        self._hear = hear

    def stage_started(self, event: StageStart) -> None:
        self._hear(event)

    def epoch_ended(self, event: EpochEnd) -> None:
        self._hear(event)

    def stage_ended(self, event: StageEnd) -> None:
        self._hear(event)

    def warned(self, diagnostic: Diagnostic) -> None:
        self._hear(diagnostic)


class NotebookLines:
    """A receiver of progress that shows a bar and one line per stage below a notebook's cell."""

    def __init__(self) -> None:
        self._display: Any = import_module("IPython.display")
        self._said: list[str] = []
        self._handle: Any = None
        self._next = 0.0

    def stage_started(self, event: StageStart) -> None:
        self._said.append(stage_text(event))
        self._show()

    def epoch_ended(self, event: EpochEnd) -> None:
        now = time.monotonic()
        # each drawing is a message to the browser, and short epochs are thousands a second
        if now >= self._next:
            self._next = now + _AGAIN
            # all attempts of a stage fill one bar
            done = (event.attempt - 1) * event.epochs + event.epoch
            self._show(epoch_text(event), done / (event.attempts * event.epochs))

    def stage_ended(self, event: StageEnd) -> None:
        self._said.append(f"  {end_text(event)}")
        self._show()

    def warned(self, diagnostic: Diagnostic) -> None:
        self._said.append(describe(diagnostic))
        self._show()

    def _show(self, now: str = "", share: float | None = None) -> None:
        bar = "" if share is None else f'<progress value="{share:.4f}"></progress>'
        # names of stages are the spec's, and may hold anything
        html = f"<pre>{escape(chr(10).join(self._said))}\n{bar} {escape(now)}</pre>"
        text = "\n".join([*self._said, *([f"  {now}"] if now else [])])
        shown = {"text/html": html, "text/plain": text}
        # only now: a display without content would leave an empty line where training fails at
        # once
        if self._handle is None:
            self._handle = self._display.display(shown, raw=True, display_id=True)
        else:
            self._handle.update(shown, raw=True)
