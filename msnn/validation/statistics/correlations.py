"""Tests residuals: are they white, and are they uncorrelated with inputs?

For noise and an independent input, the correlations at lags k and k + j are themselves correlated.
Their correlation is c(j) = Σ r_ee(m)·r_xx(m+j) / Σ r_ee(m)·r_xx(m) (Bartlett 1946). Lags therefore
leave the band in clumps, and their number is compound Poisson (Aldous, Probability Approximations
via the Poisson Clumping Heuristic, 1989). For clumps of geometric size it has the Pólya-Aeppli
distribution with the same mean and variance (Johnson, Kemp and Kotz, Univariate Discrete
Distributions, 2005, 9.7).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from statistics import NormalDist

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray, IntArray

_BAND = NormalDist().inv_cdf(0.995)
"""Number of standard deviations that contain 99 % of a normal distribution."""
_OUTSIDE = 0.01
"""Fraction of the lags of noise outside the band."""
_ACCUSED = 0.03
_LEAST_LAGS = 25
_SECONDS = 2.0
_FEW = 4
"""Minimum number of values per lag."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Correlation:
    """A correlation function at some lags, and the band in which 99 % of the values of
    noise lie.
    """

    lags: IntArray
    """Lags in samples; at positive lags, the error is later than the other signal."""
    values: FloatArray
    """From -1 to 1."""
    band: float
    """Half the width of the band for a complete set of pairs."""
    shares: FloatArray
    """Number of pairs at each lag, relative to that of the band."""
    effective: float
    """Number of independent values with the same band."""
    dispersion: float = 1.0
    """Variance of the number of lags beyond the band for noise, relative to independent lags.

    It exceeds 1 for slow inputs, because neighbouring lags leave the band together.
    """

    @property
    def bands(self) -> FloatArray:
        """The band at each lag: wider if recordings or gaps leave fewer pairs; at most 1."""
        # where there are none nothing is said
        shares = np.where(self.shares > 0, self.shares, 1.0)
        return np.minimum(self.band / np.sqrt(shares), 1.0)

    @property
    def beyond(self) -> IntArray:
        """The lags outside the band."""
        return self.lags[np.abs(self.values) > self.bands]

    @property
    def allowed(self) -> int:
        """Number of lags outside the band that noise exceeds with 3 % probability; 1 of 25."""
        return most_beyond(len(self.lags), self.dispersion, _OUTSIDE, _ACCUSED)

    @property
    def is_noise(self) -> bool:
        """True if no more lags leave the band than for noise, and none leaves it by far.

        The limit for a single lag contains all lags of noise with 99 % probability.
        """
        # of all lags together (Bonferroni): the 0.5 % on each side are shared among them
        every = NormalDist().inv_cdf(1 - 0.005 / len(self.lags)) / _BAND * self.band
        return len(self.beyond) <= self.allowed and float(np.max(self._weighed)) <= every

    @property
    def largest(self) -> tuple[int, float]:
        """The lag with the largest correlation relative to its band, and that correlation."""
        place = int(np.argmax(self._weighed))
        return int(self.lags[place]), float(self.values[place])

    @property
    def _weighed(self) -> FloatArray:
        """Magnitudes, divided by the relative width of the band at each lag."""
        return np.abs(self.values) * np.sqrt(self.shares)


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorsOfElement:
    """Correlations of the errors of one output element with themselves and with each input."""

    element: tuple[int, ...]
    count: int
    itself: Correlation | None
    """None if there are too few errors, or if they are constant."""
    inputs: Mapping[str, Correlation]
    """Correlation with each input (`u` or `u[2]`) at lags from 0, without constant inputs."""
    feedback: Mapping[str, Correlation]
    """Correlation with each input at negative lags.

    An input that follows the output (feedback) also follows its errors, which is not an error of
    the model.
    """


def lags_of(sample_time: float | None) -> int:
    """Maximum lag: 25 samples or 2 s, whichever is longer."""
    # unmodelled dynamics last seconds, independent of the sample time
    seconds = 0 if sample_time is None else round(_SECONDS / sample_time)
    return max(_LEAST_LAGS, seconds)


def residuals(
    errors: FloatArray,
    places: IntArray,
    records: IntArray,
    inputs: Mapping[str, FloatArray],
    lags: int,
) -> list[ErrorsOfElement]:
    """The correlations of errors (samples, *shape), one entry per element.

    `places` are their positions in samples, ascending within a recording; `records` are indices of
    recordings. Pairs never span two recordings. `inputs` are signals (samples,) at the same
    positions. NaN is ignored.

    r(k) = Σ e(t+k)·x(t) / √(Σe² Σx²) · n/n(k), with values minus their means and n(k) pairs of n
    values. The band of the autocorrelation of noise is 2.58/√n. With an autocorrelated input it is
    2.58·√(P/n), P = Σ r_ee(k)·r_xx(k) (Bartlett 1946; Ljung 1999, 16.6), times √(n/n(k)). The
    number of lags is at most a quarter of the values, but at least 25.
    """
    shape = errors.shape[1:]
    flat = errors.reshape(len(errors), math.prod(shape))
    places, size = _apart(places, records, lags)
    spread = {name: _on_grid(values, places, size) for name, values in inputs.items()}
    found: list[ErrorsOfElement] = []
    most = lags
    for number, element in enumerate(np.ndindex(shape)):
        error = _on_grid(flat[:, number], places, size)
        lags = _judged_lags(most, int(error.there.sum()))
        itself = _autocorrelation(error, lags)
        if itself is None:
            found.append(_unjudged(element, error))
            continue
        against = {
            name: _cross(error, values, itself.values, own.values, lags)
            for name, values in spread.items()
            if (own := _autocorrelation(values, lags)) is not None
        }
        count = int(error.there.sum())
        white = _at(itself, itself.lags > 0)
        found.append(
            ErrorsOfElement(
                element=element,
                count=count,
                itself=white,
                inputs={name: _at(each, each.lags >= 0) for name, each in against.items()},
                feedback={name: _at(each, each.lags < 0) for name, each in against.items()},
            )
        )
    return found


def _judged_lags(most: int, count: int) -> int:
    """The number of lags that `count` values can support, at least the minimum."""
    # 2 s of a converter are more samples than its records have
    return min(most, max(_LEAST_LAGS, count // _FEW))


@dataclass(frozen=True, slots=True)
class _Grid:
    """A signal minus its mean on a uniform grid, zero at missing values."""

    values: FloatArray
    there: FloatArray
    """1 at values, else 0."""


def _apart(given: IntArray, records: IntArray, lags: int) -> tuple[IntArray, int]:
    """Positions on one grid on which two recordings are more than `lags` apart."""
    # records are laid apart on one grid, so that one transform takes the pairs of all
    places, offset = given.astype(np.int64), 0
    for part in np.split(np.arange(len(given)), np.flatnonzero(np.diff(records)) + 1):
        if len(part):
            places[part] += offset - places[part[0]]
            offset = int(places[part[-1]]) + lags + 1
    return places, offset


def _on_grid(values: FloatArray, places: IntArray, size: int) -> _Grid:
    known = np.isfinite(values)
    there, found = np.zeros(size), np.zeros(size)
    there[places[known]] = 1.0
    if known.any():
        # less the mean of what is there: a gap of 0 then counts for nothing
        found[places[known]] = values[known] - values[known].mean()
    return _Grid(found, there)


def _autocorrelation(signal: _Grid, lags: int) -> Correlation | None:
    """The correlation at 0 … lags; None with too few or constant values."""
    count = float(signal.there.sum())
    # of a model that diverged squares are beyond all numbers
    with np.errstate(over="ignore"):
        power = float(signal.values @ signal.values)
    # with fewer values a lag the estimate is noise
    if count < _FEW * lags or not 0 < power < math.inf:
        return None
    means, pairs = _means(signal, signal, lags)
    found = Correlation(
        lags=np.arange(-lags, lags + 1),
        values=means / power * count,
        band=_BAND / math.sqrt(count),
        shares=pairs / count,
        effective=count,
    )
    return _at(found, found.lags >= 0)


def _cross(
    error: _Grid, signal: _Grid, own: FloatArray, other: FloatArray, lags: int
) -> Correlation:
    power = math.sqrt(float(error.values @ error.values) * float(signal.values @ signal.values))
    count = math.sqrt(float(error.there.sum()) * float(signal.there.sum()))
    # P of the formula: lag 0 once, all others on both sides
    memory = float(own[0] * other[0] + 2 * (own[1:] @ other[1:]))
    # never more independent pairs than there are
    there = float(error.there @ signal.there)
    effective = there / max(memory, 1.0)
    means, pairs = _means(error, signal, lags)
    return Correlation(
        lags=np.arange(-lags, lags + 1),
        values=means / power * count,
        band=_BAND / math.sqrt(effective),
        shares=pairs / there,
        effective=effective,
        dispersion=dispersion(own, other, _BAND, _OUTSIDE),
    )


def _at(found: Correlation, lags: BoolArray) -> Correlation:
    shown = {"lags": found.lags, "values": found.values, "shares": found.shares}
    return replace(found, **{name: each[lags] for name, each in shown.items()})


def _means(first: _Grid, second: _Grid, lags: int) -> tuple[FloatArray, FloatArray]:
    """Mean over pairs of first(t+k)·second(t), k = -lags … lags, and the number of pairs.

    Computed by fast Fourier transforms.
    """
    # zeros beyond the longest lag: a transform is periodic, and ends would meet beginnings
    size = 1 << (len(first.values) + lags).bit_length()

    def products(a: FloatArray, b: FloatArray) -> FloatArray:
        found = np.fft.irfft(np.fft.rfft(a, size) * np.conj(np.fft.rfft(b, size)), size)
        return np.concatenate([found[-lags:], found[: lags + 1]])

    # numbers of pairs are whole: transforms leave some 1e-13 on them
    pairs = np.rint(products(first.there, second.there))
    return products(first.values, second.values) / np.maximum(pairs, 1.0), pairs


def _unjudged(element: tuple[int, ...], error: _Grid) -> ErrorsOfElement:
    return ErrorsOfElement(
        element=element, count=int(error.there.sum()), itself=None, inputs={}, feedback={}
    )


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
    """The coefficients a₂, a₄, … of the series κ in `dispersion`."""
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
