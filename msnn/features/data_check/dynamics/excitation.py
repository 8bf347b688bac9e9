"""Measures the excitation by an input, and finds inputs that depend on other inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.features.data_check.dynamics.pieces import Piece

HIGHEST_ORDER = 60
_LINES = 1024
"""Samples per spectrum: a trade-off between resolution and number of averaged spectra."""
_SHARE = 0.99
_LEAST_POWER = 1e-4
"""Minimum power of a band relative to the largest: 40 dB below it, little can be learned."""
_BANDS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """The excitation by an input; frequencies relative to the sampling rate, 0 … 0.5."""

    order: int
    """Order of persistent excitation, at most `tested`."""
    tested: int
    """Maximum tested order: 60, or less for a short recording."""
    frequencies: FloatArray
    power: FloatArray
    """Power spectrum; its sum is the variance."""
    lowest: float
    highest: float
    """`lowest` and `highest` enclose 99 % of the power."""
    covered: float
    """Fraction of the bands up to Nyquist with significant power."""

    @property
    def weak(self) -> bool:
        """True if the excitation is too weak to identify responses."""
        return self.order < self.tested


def excitation(pieces: Sequence[Piece], number: int, step: float | None) -> Excitation | None:
    """The excitation by input `number`, quantised by `step`. None for fewer than 8 rows.

    An input is persistently exciting of order n if its n×n covariance has full rank (Ljung 1999,
    §13.2), and a larger covariance has rank n. The rank is determined with a tolerance for rounding
    errors. Quantisation with step q adds an error of variance
    q²/12. No eigenvalue of its n×n covariance exceeds the trace n q²/12; errors of periodic inputs
    come close to it. Floating-point
    rounding adds n ε λ₁, times ten for the sums.
    """
    series = [piece.inputs[:, number] for piece in pieces if len(piece) >= 8]
    if all(float(np.ptp(one)) == 0 for one in series):
        return None
    frequencies, power = _spectrum(series)
    if not np.sum(power) > 0:
        return None
    # half of what is left out on each side
    total = np.cumsum(power) / np.sum(power)
    edge = (1 - _SHARE) / 2
    bands = np.array([np.mean(band) for band in np.array_split(power, min(_BANDS, len(power)))])
    return Excitation(
        order=_order(series, step),
        tested=_tested(series),
        frequencies=frequencies,
        power=power,
        lowest=float(frequencies[np.searchsorted(total, edge)]),
        highest=float(frequencies[min(np.searchsorted(total, 1 - edge), len(total) - 1)]),
        covered=float(np.mean(bands > _LEAST_POWER * float(np.max(bands)))),
    )


def _order(series: Sequence[FloatArray], step: float | None) -> int:
    size = _tested(series)
    covariance: FloatArray = np.zeros((size, size))
    rows = 0
    for one in series:
        if len(one) >= size:
            past = np.lib.stride_tricks.sliding_window_view(one, size)
            covariance += past.T @ past
            rows += len(past)
    covariance /= rows
    sizes = np.linalg.eigvalsh(covariance)
    # n ε λ₁ is what rounding leaves of an eigenvalue that is 0
    least = 10 * size * float(np.finfo(np.float64).eps) * float(sizes[-1])
    if step is not None:
        least = max(least, size * step**2 / 12)
    return int(np.sum(sizes > least))


def _tested(series: Sequence[FloatArray]) -> int:
    return min(HIGHEST_ORDER, max(map(len, series)) // 3)


def _spectrum(series: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Welch's mean of the spectra of overlapping windows (IEEE Trans. Audio 15, 1967)."""
    size = min(_LINES, max(map(len, series)))
    # without its zeros at both ends
    window = np.hanning(size + 2)[1:-1]
    power, count = np.zeros(size // 2 + 1), 0
    for one in series:
        # windows that overlap by half: each row counts about once
        for first in range(0, len(one) - size + 1, max(size // 2, 1)):
            part = one[first : first + size]
            power += np.abs(np.fft.rfft(window * (part - part.mean()))) ** 2
            count += 1
    # both sides of a spectrum of real numbers, but for 0 and Nyquist
    power[1 : (size + 1) // 2] *= 2
    return np.arange(size // 2 + 1) / size, power / (count * size * np.sum(window**2))


LEAST_SHARE = 0.99
"""Fraction of an input's variance above which standard errors increase tenfold, by 1/√(1 − R²)."""
_NAMED = 0.05


@dataclass(frozen=True, slots=True)
class Dependence:
    """Input `number` ≈ Σ factor · input, with the coefficient of determination `share`."""

    number: int
    share: float
    factors: tuple[tuple[int, float], ...]
    """The other inputs with their factors, in the units of both."""


def dependences(pieces: Sequence[Piece]) -> tuple[Dependence, ...]:
    """The inputs determined by others in the same row; of each group, all but the first."""
    if not pieces:
        return ()
    table = np.concatenate([piece.inputs for piece in pieces])
    # an input that stands still depends on nothing
    deviation = np.std(table, axis=0)
    moving = np.flatnonzero(deviation > 0)
    # three rows a number, or any table is a combination of others
    if len(moving) < 2 or len(table) < 3 * len(moving):
        return ()
    scaled = (table[:, moving] - table[:, moving].mean(axis=0)) / deviation[moving]
    correlation = scaled.T @ scaled / len(scaled)
    found: list[Dependence] = []
    # the first one that moves is kept; each later one is compared with those kept
    kept = [0]
    for place in range(1, len(moving)):
        left, right = correlation[np.ix_(kept, kept)], correlation[kept, place]
        factors: FloatArray = np.asarray(
            np.linalg.lstsq(left, right, rcond=1e-12)[0], dtype=np.float64
        )
        share = float(factors @ right)
        if share < LEAST_SHARE:
            kept.append(place)
            continue
        named = [
            (
                int(moving[other]),
                float(factor * deviation[moving[place]] / deviation[moving[other]]),
            )
            for other, factor in zip(kept, factors.tolist(), strict=True)
            if abs(factor) > _NAMED
        ]
        found.append(Dependence(int(moving[place]), min(share, 1.0), tuple(named)))
    return tuple(found)
