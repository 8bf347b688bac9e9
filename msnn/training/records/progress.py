"""Reports the progress of a training; a command line shows it, a program may ignore it."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol, TextIO

from msnn.training.plans.stage_result import monitor_order
from spec_schema.diagnostics.diagnostic import Diagnostic, describe


@dataclass(frozen=True, slots=True, kw_only=True)
class StageStart:
    """The event that a stage begins: its name, number of epochs, and numbers and kinds of
    rollouts.
    """

    number: int
    stages: int
    name: str
    epochs: int
    starts: int
    horizon: str
    monitored_on: str
    attempts: int
    weights: Mapping[str, float] | None = None
    """Weights of losses if they are 1/variance of the predicted signals."""
    fed_back: tuple[str, ...] = ()
    """Inputs that are fed by predictions of outputs."""
    epoch: int = 0
    """Epochs completed before the run was resumed."""
    counted: int = 1
    """Maximum number of rollouts that score the same row."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EpochEnd:
    """The event that an epoch is complete, with its losses, monitor and duration.

    `losses` are unweighted; `total` is their weighted sum.
    """

    stage: str
    attempt: int
    """Number of the attempt (`starts:`), from 1 to `attempts`."""
    attempts: int
    epoch: int
    epochs: int
    total: float
    losses: dict[str, float]
    monitor: float
    best: float
    best_epoch: int
    lr: float | None
    """Learning rate of the epoch without per-parameter factors; None for methods without one."""
    horizon: int
    """Steps of the longest rollout of the epoch."""
    seconds: float
    """Since the attempt began."""

    def record(self) -> dict[str, Any]:
        """All fields of the event by name, for `metrics.jsonl`."""
        return {each.name: getattr(self, each.name) for each in fields(self)}


@dataclass(frozen=True, slots=True, kw_only=True)
class StageEnd:
    """The event that a stage is complete: the reason, its best monitor and epoch."""

    stage: str
    attempt: int
    """The best attempt; the other fields belong to it."""
    attempts: int
    epochs: int
    best: float
    best_epoch: int
    seconds: float
    reason: str


def leading_epochs(attempts: Iterable[Sequence[EpochEnd]]) -> Sequence[EpochEnd]:
    """The epochs of the leading attempt; every attempt has at least one."""
    return min(attempts, key=lambda epochs: monitor_order(epochs[-1].best))


class Progress(Protocol):
    """The receiver of a training's events, in their order; pass one to `train`."""

    def stage_started(self, event: StageStart) -> None: ...

    def epoch_ended(self, event: EpochEnd) -> None: ...

    def stage_ended(self, event: StageEnd) -> None: ...

    def warned(self, diagnostic: Diagnostic) -> None: ...


class Silent:
    """A receiver that ignores all events."""

    def stage_started(self, event: StageStart) -> None:
        del event

    def epoch_ended(self, event: EpochEnd) -> None:
        del event

    def stage_ended(self, event: StageEnd) -> None:
        del event

    def warned(self, diagnostic: Diagnostic) -> None:
        del diagnostic


class Lines:
    """A receiver that prints lines for people.

    On a terminal it rewrites one line; elsewhere it prints one every few seconds.
    """

    def __init__(self, stream: TextIO, *, terminal: bool, interval: float = 5.0) -> None:
        self._stream = stream
        self._terminal = terminal
        self._interval = 0.1 if terminal else interval
        self._shown = -float("inf")

    def stage_started(self, event: StageStart) -> None:
        """Prints the name and size of a stage that begins."""
        self._shown = -float("inf")
        self._line(stage_text(event))

    def epoch_ended(self, event: EpochEnd) -> None:
        """Shows the losses, at most once per interval."""
        now = time.monotonic()
        if now - self._shown < self._interval:
            return
        self._shown = now
        text = f"  {epoch_text(event)}"
        if self._terminal:
            self._stream.write(f"\r\x1b[2K{text}")
            self._stream.flush()
        else:
            self._line(text)

    def stage_ended(self, event: StageEnd) -> None:
        """Shows the result of the stage."""
        self._line(f"  {end_text(event)}")

    def warned(self, diagnostic: Diagnostic) -> None:
        """Prints a warning on a line of its own."""
        self._line(describe(diagnostic))

    def _line(self, text: str) -> None:
        start = "\r\x1b[2K" if self._terminal else ""
        self._stream.write(f"{start}{text}\n")
        self._stream.flush()


class LinesOfStages(Lines):
    """Prints lines until the last stage is complete; later warnings are collected in `at_end`."""

    def __init__(self, stream: TextIO, *, terminal: bool) -> None:
        super().__init__(stream, terminal=terminal)
        self.at_end: list[Diagnostic] = []
        self._is_last = self._is_over = False

    def stage_started(self, event: StageStart) -> None:
        """Prints the name and size of a stage that begins, and notes if it is the last one."""
        self._is_last = event.number == event.stages
        super().stage_started(event)

    def stage_ended(self, event: StageEnd) -> None:
        """Prints the result of the stage; later warnings are collected if it was the last one."""
        self._is_over = self._is_last
        super().stage_ended(event)

    def warned(self, diagnostic: Diagnostic) -> None:
        """Prints a warning of a stage on its own line, or collects it after the last stage."""
        if self._is_over:
            self.at_end.append(diagnostic)
        else:
            super().warned(diagnostic)


def stage_text(event: StageStart) -> str:
    """A stage and its size, in a line."""
    return (
        f"stage {event.number}/{event.stages} {event.name}: {event.epochs} epochs, "
        f"{event.starts} starts, horizon {event.horizon}, best on {event.monitored_on}"
        + (f", best of {event.attempts} runs" if event.attempts > 1 else "")
        + _overlap(event)
        + _feedback(event)
        + _weights(event)
        + (f", goes on after epoch {event.epoch}" if event.epoch else "")
    )


def _overlap(event: StageStart) -> str:
    if event.counted == 1:
        return ""
    return f", rollouts overlap: a row counts up to {event.counted} times, in `validate` once"


def _feedback(event: StageStart) -> str:
    return f", predictions fed back into {', '.join(event.fed_back)}" if event.fed_back else ""


def _weights(event: StageStart) -> str:
    """The weights that default losses got from the data."""
    if event.weights is None:
        return ""
    listed = ", ".join(f"{name} {weight:.3g}" for name, weight in event.weights.items())
    return f", losses weighed by 1/variance: {listed}"


def epoch_text(event: EpochEnd) -> str:
    """The losses of an epoch and the time that is left, in a line."""
    epochs_left = event.epochs * (event.attempts - event.attempt + 1) - event.epoch
    left = event.seconds / event.epoch * epochs_left
    return (
        f"{_run(event.attempt, event.attempts)}"
        f"epoch {event.epoch}/{event.epochs}  loss {event.total:.4g}  "
        f"monitor {event.monitor:.4g}  best {event.best:.4g} (epoch {event.best_epoch})  "
        f"{event.seconds:.1f} s, {left:.0f} s left"
    )


def end_text(event: StageEnd) -> str:
    """The end of a stage in a line."""
    return (
        f"{_run(event.attempt, event.attempts)}{event.reason} after {event.epochs} epochs, "
        f"best {event.best:.6g} (epoch {event.best_epoch}), {event.seconds:.1f} s"
    )


def _run(attempt: int, attempts: int) -> str:
    return f"run {attempt}/{attempts}: " if attempts > 1 else ""
