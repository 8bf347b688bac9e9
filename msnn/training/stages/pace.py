"""Chooses the number of batches per engine call, so that a call takes a fraction of a second."""

from __future__ import annotations

from dataclasses import dataclass

CALL = 0.25
"""Maximum seconds per call: the delay of interrupts and time limits."""


@dataclass(slots=True)
class Pace:
    """Measures calls to choose their number of batches; begins with one batch and doubles.

    Small models run whole epochs in one call: after eight calls, a stage is at 200 batches. A batch
    that takes longer than `CALL` is a call of its own.
    """

    most: int
    seconds: float = 0.0
    """Duration of the last call."""
    batches: int = 1
    """Number of batches of the next call."""

    def called(self, batches: int, seconds: float) -> None:
        """Records the duration of a call."""
        self.seconds = seconds
        fitting = int(batches * CALL / seconds) if seconds > 0.0 else self.most
        self.batches = max(1, min(self.most, 2 * self.batches, fitting))
