"""Lists what the loops of training give to the graphs that they run, besides a program's reads."""

from __future__ import annotations

from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class StateAdjoint:
    """∂S/∂(the next value of a state), of a buffer ∂S/∂(its newest sample)."""

    state: str


@dataclass(frozen=True, slots=True)
class NewestSample:
    """The sample that the forward step gave a buffer."""

    buffer: str


@dataclass(frozen=True, slots=True)
class KeptRow:
    """The value that a node had at this time, kept in a row over time."""

    node: int


@dataclass(frozen=True, slots=True)
class LossScale:
    """∂S/∂(the sum of a loss over the elements of this step)."""

    loss: str


TrainingValue = StateAdjoint | NewestSample | KeptRow | LossScale
