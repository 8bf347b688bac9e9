"""Counts how often measured values lie inside prediction intervals, and judges the shares.

The verdict allows for chance: over n independent values a share p varies by √(p (1 − p) / n).
Errors with memory make fewer of the scored values, n / (1 + 2 Σ r(k)²) with their autocorrelation
r, whose square is that of the squares of normal errors. From a tenth of the deviation of one value
on a difference counts, however many values there are.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.simulation.intervals import quantile

LEVELS = (0.5, 0.8, 0.95)
_CHANCE = 2.58
"""Standard deviations within which 99 % of what chance does lies."""
_OPPOSITE = 0.5
"""Parts of what is allowed beyond which shares too small and too large contradict each other."""
_MATTERS = 0.1
"""Part of the deviation of one value that is small enough for any use of an interval."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """The shares of one output's targets inside its intervals."""

    observed: tuple[float, ...]
    """The share inside, for each of LEVELS."""
    elements: FloatArray
    """The same of each element, (levels, *shape)."""
    half_width: float
    """Half the mean width of the interval of the last level."""
    from_parameters: float
    """Share of the variance that uncertain parameters make, on average."""
    count: int
    effective: float
    """How many independent values they are worth."""

    @property
    def verdict(self) -> str:
        """The words for the width of the intervals by these shares."""
        off = [
            (found - level) / (math.sqrt(level * (1 - level)) * self._allowed)
            for found, level in zip(self.observed, LEVELS, strict=True)
        ]
        # what all levels allow for is judged at once: one share beyond is enough
        if max(map(abs, off)) <= 1.0:
            return "as wide as they say"
        # narrow ones too full and wide ones too empty: no width would be right for both
        if max(off) > _OPPOSITE and min(off) < -_OPPOSITE:
            which = "many small ones, some far out" if off[0] > 0 else "most of them of one size"
            return f"errors are not normal: {which}"
        if min(off) < -1.0:
            return "too narrow: errors are larger here than in training"
        return "too wide: errors are smaller here than in training"

    @property
    def _allowed(self) -> float:
        return max(_CHANCE / math.sqrt(max(self.effective, 1.0)), _MATTERS)


class Counts:
    """Adds up what lies inside while an output is simulated."""

    def __init__(self, noise: FloatArray) -> None:
        """`noise` is σ² of each element."""
        self._noise = noise
        self._inside = np.zeros((len(LEVELS), *noise.shape))
        self._number = np.zeros(noise.shape)
        self._widths, self._shares = 0.0, 0.0

    def add(self, prediction: FloatArray, variance: FloatArray, target: FloatArray) -> None:
        """Some scored samples, (samples, *shape); what was not measured counts for nothing."""
        there = ~np.isnan(target)
        with np.errstate(all="ignore"):  # a prediction that has left the numbers is outside
            total = variance + self._noise
            distance = np.abs(prediction - target)
            for place, level in enumerate(LEVELS):
                # NaN and ∞ are no distance: outside
                reached = there & (distance <= quantile(level) * np.sqrt(total))
                self._inside[place] += reached.sum(axis=0)
            self._widths += float(np.sum(np.sqrt(total), where=there))
            # without noise or doubt the variance is 0, and no share of it is
            share = np.divide(variance, total, out=np.zeros_like(total), where=total > 0)
            self._shares += float(np.sum(share, where=there))
        self._number += there.sum(axis=0)

    def coverage(self, autocorrelations: Iterable[FloatArray]) -> Coverage:
        """The shares so far; of each element's errors the autocorrelation at lags from 1."""
        number = float(self._number.sum())
        memories = [1.0 + 2.0 * float(each @ each) for each in autocorrelations]
        # elements that could not be judged have the memory of those that could
        memory = sum(memories) / len(memories) if memories else 1.0
        with np.errstate(invalid="ignore", divide="ignore"):
            elements = self._inside / self._number
            observed = self._inside.reshape(len(LEVELS), -1).sum(axis=1) / number
            return Coverage(
                observed=tuple(observed.tolist()),
                elements=elements,
                half_width=quantile(LEVELS[-1]) * float(np.divide(self._widths, number)),
                from_parameters=float(np.divide(self._shares, number)),
                count=int(number),
                effective=number / memory,
            )
