"""Measures the coverage of prediction intervals, and compares it with their level.

The verdict allows for chance: for n independent values, a coverage p varies by √(p (1 − p) / n).
Autocorrelated errors reduce n to n / (1 + 2 Σ r(k)²) with the autocorrelation r, because the
squares of normal errors have autocorrelation r². Differences below a tenth of the standard
deviation of one value are always tolerated.
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
"""Number of standard deviations that contain 99 % of random variation."""
_OPPOSITE = 0.5
"""Fraction of the tolerance beyond which too small and too large coverages contradict."""
_MATTERS = 0.1
"""Difference that is always tolerated, in standard deviations of one value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """The coverage of one output's prediction intervals."""

    observed: tuple[float, ...]
    """Coverage at each of LEVELS."""
    elements: FloatArray
    """Coverage of each element, (levels, *shape)."""
    half_width: float
    """Half the mean width of the interval of the last level."""
    from_parameters: float
    """Mean fraction of the variance that comes from uncertain parameters."""
    count: int
    effective: float
    """Number of independent values with the same information."""

    @property
    def verdict(self) -> str:
        """The text that describes the width of the intervals."""
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
    """Counts targets inside intervals while an output is simulated."""

    def __init__(self, noise: FloatArray) -> None:
        """`noise` is σ² of each element."""
        self._noise = noise
        self._inside = np.zeros((len(LEVELS), *noise.shape))
        self._number = np.zeros(noise.shape)
        self._widths, self._shares = 0.0, 0.0

    def add(self, prediction: FloatArray, variance: FloatArray, target: FloatArray) -> None:
        """Adds scored samples (samples, *shape); missing targets are ignored."""
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
        """The coverage of the samples added so far.

        `autocorrelations` are those of the errors of each element, at lags from 1; they widen the
        tolerance.
        """
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
