"""Holds the estimates of an estimator at one sample."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from numpy.typing import NDArray

Array = NDArray[Any]


class FilterStatus(IntEnum):
    """The outcome of a correction; the numbers are those of controllers."""

    FILTERED = 0
    """The estimate is that of the measurements."""
    CAPPED = 1
    """Of a moving horizon: its iterations ran out before the tolerance."""
    DIVERGED = 2
    """Something is not finite: the estimate is as it was; of a moving horizon, the filter's."""
    INPUT_NOT_FINITE = 3
    """An input is NaN, or anything given infinite: the estimate is as it was."""
    NOT_INITIALISED = 4
    """Some state has no initial value."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """The estimates at a sample, by name and in the units of the spec."""

    status: FilterStatus
    states: dict[str, Array]
    parameters: dict[str, Array]
    std: dict[str, Array]
    """Standard deviations of both."""
    innovations: dict[str, Array]
    """Measurement minus prediction, by signal; NaN without a measurement."""


@dataclass(frozen=True, slots=True)
class WindowEstimate(Estimate):
    """A moving-horizon estimate; `std` and `innovations` are those of the filter."""

    cost: float
    """Of the window: squares of errors and noise, by their deviations; NaN without a solve."""
    residual: float
    """Largest error of the optimality conditions; ∞ without a solve."""
    iterations: int
