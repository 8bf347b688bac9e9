"""Describes prior knowledge of learned arrays: priors, penalties and statistics."""

from __future__ import annotations

from typing import Literal

from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Prior:
    """A Gaussian prior: mean and standard deviation of each element of a parameter."""

    mean: float
    std: float


@dataclass(frozen=True, slots=True)
class Penalty:
    """A penalty on one learned array, not differentiable where elements or slices are 0.

    Proximal optimisers handle it apart from the other losses (decision 0215). They use its value,
    but not its derivative.
    """

    parameter: str
    over: str | None
    """The axis whose slices are penalised by their norms; None penalises the magnitude of each
    element."""


@dataclass(frozen=True, slots=True)
class Statistic:
    """A statistic of a signal over the training rows; it initialises a parameter."""

    kind: Literal["mean", "std"]
    signal: str
