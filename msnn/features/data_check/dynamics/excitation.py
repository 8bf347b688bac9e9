"""Measures what an input can teach: the band of its power, its order of excitation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.features.data_check.dynamics.pieces import Piece

HIGHEST_ORDER = 60
_LINES = 1024
"""Rows of one spectrum: resolution against the number of spectra that are averaged."""
_SHARE = 0.99
_LEAST_POWER = 1e-4
"""Of the largest power of a band: 40 dB below it little is learned."""
_BANDS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """The excitation by an input; frequencies in parts of the sampling rate, 0 … 0.5."""

    order: int
    """Order of persistent excitation, up to `tested`."""
    tested: int
    """60, or less where the record is short."""
    frequencies: FloatArray
    power: FloatArray
    """Spectrum; its sum is the variance."""
    lowest: float
    highest: float
    """Between these lie 99 % of the power."""
    covered: float
    """Share of the bands up to Nyquist that have power."""

    @property
    def weak(self) -> bool:
        """Whether responses cannot be told from what it excites."""
        return self.order < self.tested


def excitation(pieces: Sequence[Piece], number: int, step: float | None) -> Excitation | None:
    """The excitation by input `number`, quantised by `step`. None for fewer than 8 rows.

    An input excites order n where its n×n covariance has full rank (Ljung 1999, §13.2), and a
    larger covariance has rank n. Rank is counted down to what rounding makes of a matrix that has
    less: rounding by an instrument adds an error of variance q²/12, whose n×n covariance has no
    eigenvalue beyond its trace n q²/12, which errors of periodic inputs come near to; that of
    numbers is n ε λ₁, ten times as much for the sums.
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
