"""Computes how many lags of noise leave a confidence band, for autocorrelated inputs.

For noise and an independent input, the correlations at lags k and k + j are themselves correlated.
Their correlation is c(j) = Σ r_ee(m)·r_xx(m+j) / Σ r_ee(m)·r_xx(m) (Bartlett 1946). Lags therefore
leave the band in clumps, and their number is compound Poisson (Aldous, Probability Approximations
via the Poisson Clumping Heuristic, 1989). For clumps of geometric size it has the Pólya-Aeppli
distribution with the same mean and variance (Johnson, Kemp and Kotz, Univariate Discrete
Distributions, 2005, 9.7).
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from msnn.data.dataset import FloatArray

_TERMS = 120


def dispersion(error: FloatArray, signal: FloatArray, band: float, outside: float) -> float:
    """Variance of the number of lags beyond a band, relative to that of independent lags.

    D = 1 + 2 Σ (1 − j/n)·κ(c(j)), j = 1 … n − 1, from the autocorrelations of both at lags 0 … n.
    κ(c) = Σ aₘ cᵐ over even m, aₘ = (2 φ(b)·Heₘ₋₁(b))² / (m!·p(1 − p)). It is the correlation of
    the events that two normal values with correlation c leave the band ± b, each with probability p
    (Mehler's formula).
    """
    lags = len(error) - 1
    both = [np.concatenate([each[:0:-1], each]) for each in (error, signal)]
    size = 1 << (4 * lags + 1).bit_length()
    spectra = [np.fft.rfft(each, size) for each in both]
    sums = np.fft.irfft(spectra[0] * spectra[1], size)[2 * lags : 3 * lags]
    squares = np.minimum(np.square(sums / max(float(sums[0]), 1.0)), 1.0)
    together = np.zeros(lags)
    for term in reversed(_terms(band, outside)):
        together = (together + term) * squares
    later = np.arange(1, lags)
    return 1.0 + 2.0 * float((1.0 - later / lags) @ together[1:])


@cache
def _terms(band: float, outside: float) -> tuple[float, ...]:
    """The coefficients a₂, a₄, … of κ."""
    # Heₘ / √m!, which stays small
    hermite = [1.0, band]
    for m in range(2, _TERMS):
        last = band * hermite[m - 1] - math.sqrt(m - 1) * hermite[m - 2]
        hermite.append(last / math.sqrt(m))
    slope = 2.0 * math.exp(-band * band / 2.0) / math.sqrt(2.0 * math.pi)
    spread = outside * (1.0 - outside)
    return tuple((slope * hermite[m - 1]) ** 2 / (m * spread) for m in range(2, _TERMS, 2))


def most_beyond(lags: int, dispersion: float, outside: float, accused: float) -> int:
    """Number of lags beyond the band that noise exceeds with probability `accused` at most."""
    share = (dispersion - 1.0) / (dispersion + 1.0)
    clumps = lags * outside * (1.0 - share)
    before, now = 0.0, math.exp(-clumps)
    left, number = 1.0 - now, 0
    while left > accused and number < lags:
        number += 1
        growth = 2.0 * share * (number - 1) + clumps * (1.0 - share)
        following = (growth * now - share * share * (number - 2) * before) / number
        before, now = now, following
        left -= now
    return number
