"""Judges what a model leaves unexplained: are its errors noise, and do inputs explain them?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.validation.statistics.clumps import dispersion, most_beyond

_BAND = NormalDist().inv_cdf(0.995)
"""Of a normal distribution 99 % lie within so many standard deviations."""
_OUTSIDE = 0.01
"""Of the lags of noise so many leave the band."""
_ACCUSED = 0.03
_LEAST_LAGS = 25
_SECONDS = 2.0
_FEW = 4
"""So many values a lag are the least from which anything can be said."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Correlation:
    """A correlation at lags, with the band in which 99 % of those of noise lie."""

    lags: IntArray
    """In samples; at positive ones the error comes after what it is correlated with."""
    values: FloatArray
    """From -1 to 1."""
    band: float
    """Where each value has its pair."""
    shares: FloatArray
    """Of the pairs that the band counts, those that there are at each lag."""
    effective: float
    """How many independent values would have this band."""
    dispersion: float = 1.0
    """The variance of the number of lags of noise beyond the band, over that of independent lags:
    neighbours leave it together where an input is slow."""

    @property
    def bands(self) -> FloatArray:
        """The band at each lag: wider where records or gaps leave fewer pairs; 1 holds all."""
        # where there are none nothing is said
        shares = np.where(self.shares > 0, self.shares, 1.0)
        return np.minimum(self.band / np.sqrt(shares), 1.0)

    @property
    def beyond(self) -> IntArray:
        """The lags at which it leaves the band."""
        return self.lags[np.abs(self.values) > self.bands]

    @property
    def allowed(self) -> int:
        """The number of lags there that no more than 3 % of noise exceeds; 1 of 25."""
        return most_beyond(len(self.lags), self.dispersion, _OUTSIDE, _ACCUSED)

    @property
    def is_noise(self) -> bool:
        """Whether no more lags leave the band than those of noise, and none leaves it by far.

        By far is where all lags of noise are 99 % of the time.
        """
        # of all lags together (Bonferroni): the 0.5 % on each side are shared among them
        every = NormalDist().inv_cdf(1 - 0.005 / len(self.lags)) / _BAND * self.band
        return len(self.beyond) <= self.allowed and float(np.max(self._weighed)) <= every

    @property
    def largest(self) -> tuple[int, float]:
        """The lag that is largest for its band, and the correlation there."""
        place = int(np.argmax(self._weighed))
        return int(self.lags[place]), float(self.values[place])

    @property
    def _weighed(self) -> FloatArray:
        """Magnitudes, at each lag as many times smaller as its band is wider."""
        return np.abs(self.values) * np.sqrt(self.shares)


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorsOfElement:
    """The errors of one element of an output, against themselves and against each input."""

    element: tuple[int, ...]
    count: int
    itself: Correlation | None
    """None where there are too few errors, or they do not vary."""
    inputs: Mapping[str, Correlation]
    """By input, `u` or `u[2]`, at lags from 0: what it does later. Those that do not vary are left
    out."""
    feedback: Mapping[str, Correlation]
    """By input, at negative lags: an input that follows the output follows its errors, which is no
    fault of the model."""


def lags_of(sample_time: float | None) -> int:
    """Up to which lag errors are judged: 25 samples or 2 s, whichever is longer."""
    # dynamics that nobody models last seconds, however short the sample time is
    seconds = 0 if sample_time is None else round(_SECONDS / sample_time)
    return max(_LEAST_LAGS, seconds)


def residuals(
    errors: FloatArray,
    places: IntArray,
    records: IntArray,
    inputs: Mapping[str, FloatArray],
    lags: int,
) -> list[ErrorsOfElement]:
    """The correlations of (samples, *shape) errors, an entry an element.

    `places` are their moments in samples, which rise within a record, `records` the record of each;
    no pair of values is of two records. `inputs` are (samples,) signals at the same places. NaN is
    left out.

    r(k) = Σ e(t+k)·x(t) / √(Σe² Σx²) · n/n(k) of values less their means, n(k) pairs of n values.
    Of noise against itself the band is 2.58/√n; against an input with memory it is
    2.58·√(P/n), P = Σ r_ee(k)·r_xx(k) (Bartlett 1946; Ljung 1999, 16.6), times √(n/n(k)). No more
    lags are judged than a quarter of the values, but 25.
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
    """As many of the lags as so many values tell of; of too few for the least, these."""
    # 2 s of a converter are more samples than its records have
    return min(most, max(_LEAST_LAGS, count // _FEW))


@dataclass(frozen=True, slots=True)
class _Grid:
    """A signal less its mean at equal distances, zero where it is not there."""

    values: FloatArray
    there: FloatArray
    """1 where there is a value, else 0."""


def _apart(given: IntArray, records: IntArray, lags: int) -> tuple[IntArray, int]:
    """Places on one grid on which values of two records are more than `lags` apart."""
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
    """The correlation at 0 … lags; None of too few values, or of values that do not vary."""
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
    """Mean over pairs of first(t+k)·second(t), k = -lags … lags, and the pairs.

    By fast Fourier transforms.
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
