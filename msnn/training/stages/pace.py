"""Chooses how many batches an engine is given at once, so that a call takes a part of a second."""

from __future__ import annotations

from dataclasses import dataclass

CALL = 0.25
"""Seconds that a call may take: so long keyboard and clock wait."""


@dataclass(slots=True)
class Pace:
    """Measures batches to choose how many make a call; begins with one and doubles.

    Whole epochs of small models are one call: eight calls after its begin a stage is at 200
    batches. A batch that takes longer than `CALL` is a call of its own.
    """

    most: int
    seconds: float = 0.0
    """Of the last call."""
    batches: int = 1
    """Of the next call."""

    def called(self, batches: int, seconds: float) -> None:
        """Notes how long a call of so many batches took."""
        self.seconds = seconds
        fitting = int(batches * CALL / seconds) if seconds > 0.0 else self.most
        self.batches = max(1, min(self.most, 2 * self.batches, fitting))
