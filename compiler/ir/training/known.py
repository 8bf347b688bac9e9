"""Says what is known of learned arrays beside the data."""

from __future__ import annotations

from typing import Literal

from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Prior:
    """The mean and deviation of every number of a parameter, known before the data."""

    mean: float
    std: float


@dataclass(frozen=True, slots=True)
class Penalty:
    """A loss of one learned array alone, which has a corner where numbers or slices are 0.

    Optimisers that can take steps to the corner itself take it apart from the others (decision
    0215): its value counts, its slope does not.
    """

    parameter: str
    over: str | None
    """The axis whose slices are taken by their norms; None for the magnitude of each number."""


@dataclass(frozen=True, slots=True)
class Statistic:
    """The statistic of a signal's training rows to which a parameter is set before all stages."""

    kind: Literal["mean", "std"]
    signal: str
