"""Lists the values that the training loops pass to their graphs."""

from __future__ import annotations

from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class StateAdjoint:
    """∂S/∂(the next value of a state); for a buffer, ∂S/∂(its newest sample)."""

    state: str


@dataclass(frozen=True, slots=True)
class NewestSample:
    """The sample that the forward step appended to a buffer."""

    buffer: str


@dataclass(frozen=True, slots=True)
class KeptRow:
    """The value of a node at this time, stored by the forward pass in one row per time."""

    node: int


@dataclass(frozen=True, slots=True)
class LossScale:
    """∂S/∂(the sum of a loss over the elements of this step)."""

    loss: str


TrainingValue = StateAdjoint | NewestSample | KeptRow | LossScale
