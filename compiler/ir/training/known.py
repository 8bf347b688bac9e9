"""Says what is known of learned arrays beside the data."""

from __future__ import annotations

from typing import Literal

from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of every number of a parameter before the data: mean and deviation."""

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
    """What of a signal's training rows a parameter is, set once before the first stage."""

    kind: Literal["mean", "std"]
    signal: str
