"""Prints the progress of a comparison: one line per training, with the remaining time."""

from __future__ import annotations

import time
from typing import TextIO

from msnn.features.comparison.trial import Trial, TrialOutcome
from spec_schema.diagnostics.source import printable


class TrialLines:
    """Prints a line for every completed training, and each warning once.

    Lines are at least `pause` seconds apart; in between, only errors are printed.
    """

    def __init__(self, stream: TextIO, pause: float = 0.0) -> None:
        self._stream = stream
        # so that the first line is printed at once
        self._pause, self._printed = pause, -pause
        self._began = time.monotonic()
        self._all = self._ended = self._trained = 0
        self._said: set[str] = set()

    def began(self, trials: int) -> None:
        self._all, self._began = trials, time.monotonic()

    def ended(self, trial: Trial, outcome: TrialOutcome) -> None:
        self._ended += 1
        line = outcome.line
        which = printable(trial.variant.label)
        which += f", seed {trial.seed}" if trial.seed else ""
        which += f", fold {trial.fold}" if trial.fold is not None else ""
        left = self._left(outcome)
        now = time.monotonic()
        is_last = self._ended == self._all
        if is_last or line.state != "finished" or now - self._printed >= self._pause:
            self._print(f"{self._ended}/{self._all}  {which}: {_how(outcome)}{left}")
            self._printed = now
        new = [said for said in (*_reasons(outcome), *line.warnings) if said not in self._said]
        self._said.update(new)
        for said in new:
            self._print(said)

    def _left(self, outcome: TrialOutcome) -> str:
        self._trained += outcome.is_new
        left = self._all - self._ended
        if not left or not self._trained:
            return ""
        # of those that were trained here: what the log has costs no time, and others may still be
        # in it
        each = (time.monotonic() - self._began) / self._trained
        return f"; at most {left * each:.0f} s left"

    def _print(self, text: str) -> None:
        self._stream.write(f"{text}\n")
        self._stream.flush()


def _how(outcome: TrialOutcome) -> str:
    line = outcome.line
    if line.state != "finished":
        return line.state
    taken = "" if outcome.is_new else ", trained before"
    return f"{line.reason}, monitor {line.monitor:.5g}, {line.seconds:.2f} s{taken}"


def _reasons(outcome: TrialOutcome) -> tuple[str, ...]:
    return () if outcome.line.state == "finished" else (outcome.line.reason,)
