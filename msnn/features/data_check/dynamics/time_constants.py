"""Determines the time constants of impulse responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msnn.data.dataset import FloatArray
from msnn.features.data_check.dynamics.impulse_response import Responses, responses
from msnn.features.data_check.dynamics.pieces import Piece, rows_of, slower

ComplexArray = NDArray[np.complex128]

_NO_POLES: ComplexArray = np.zeros(0, np.complex128)
_HIGHEST_ORDER = 4
_LEAST = 0.03
"""Singular values below this fraction of the largest are neglected."""
_SLOWER = 4
_FEWEST_ROWS = 200
_LEAST_ENERGY = 0.01
"""Modes with a smaller fraction of the responses' energy are neglected."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeConstants:
    """The modes of the responses of one series, in rows."""

    modes: tuple[float, ...]
    """Time constants −1/ln|z| of the poles z, the slowest first; infinite for an integrator."""
    periods: tuple[float, ...]
    """Period of each mode in rows; infinite without oscillation."""
    natural: tuple[float, ...]
    """1/|ln z| of each mode: its time constant, or 1/ω₀ of an oscillation."""
    settling: float | None
    """Rows until a step response is within 2 %; None if it has not settled in any estimate."""

    @property
    def slowest(self) -> float:
        """The largest 1/|ln z|, the scale of the slowest motion in rows."""
        return max(self.natural)

    @property
    def fastest(self) -> float:
        return min(self.natural)


def time_constants(pieces: Sequence[Piece], first: Responses) -> TimeConstants | None:
    """The modes of a series, from its responses to all inputs; None if none is visible.

    If responses are longer than the estimated lags, the estimate is repeated with means of 4, 16, …
    rows; fast modes keep their first estimates. A state-space model follows from the Hankel matrix
    of the responses, shifted by one lag (Kung 1978). Its order is the number of singular values
    above the effect of the responses' errors.
    """
    # responses that last longer than the lags are seen at fewer rows a second
    found, factor = first, 1
    while True:
        seen = [i for i in range(len(found.values)) if found.delay(i) is not None]
        if not seen:
            return None
        settled = [found.settled(i) for i in seen]
        if all(lag is not None for lag in settled):
            break
        factor *= _SLOWER
        fewer = slower(pieces, factor)
        again = responses(fewer) if rows_of(fewer) >= _FEWEST_ROWS else None
        # too few rows, or nothing visible any more: the estimate before stays
        if again is None or all(again.delay(i) is None for i in range(len(again.values))):
            factor //= _SLOWER
            break
        found = again
    begins = {i: _begin(found.delay(i), first.delay(i), factor) for i in seen}
    constants, periods, natural = factor * _times(_poles(found, begins))
    if factor > 1:
        # means say nothing of what is over within one of them, the rows do
        told = [(i, delay) for i in seen if (delay := first.delay(i)) is not None]
        rows = _times(_poles(first, {i: _begin(delay, delay, 1) for i, delay in told}))
        slow, fast = natural >= factor, rows[2] < factor
        parts = zip((constants, periods, natural), rows, strict=True)
        constants, periods, natural = (np.concatenate([a[slow], b[fast]]) for a, b in parts)
    if not len(natural):
        return None
    if factor == 1 and rows_of(pieces) < _FEWEST_ROWS and np.max(natural) > found.lags:
        return None  # longer than all that was seen of it
    order = np.argsort(-constants, kind="stable")
    lags = [lag for lag in settled if lag is not None]
    return TimeConstants(
        modes=tuple(constants[order].tolist()),
        periods=tuple(periods[order].tolist()),
        natural=tuple(natural[order].tolist()),
        settling=float(max(lags) * factor) if len(lags) == len(settled) else None,
    )


def _times(poles: ComplexArray) -> FloatArray:
    """Time constants, periods and natural times of poles, in rows of their estimate."""
    sizes = np.abs(poles)
    with np.errstate(divide="ignore"):
        # z = e^(−1/τ); on and outside the unit circle nothing decays
        constants = np.where(sizes < 1, -1 / np.log(np.minimum(sizes, 1)), np.inf)
        turns = np.abs(np.angle(poles))
        periods = np.where(turns > 0, 2 * np.pi / turns, np.inf)
        natural = np.where(sizes < 1, 1 / np.abs(np.log(poles)), np.inf)
    return np.stack([constants, periods, natural])


def _begin(delay: int | None, of_rows: int | None, factor: int) -> int:
    """The first lag from which a response is a sum of exponentials."""
    # lag 0 is feedthrough, and a delay would be poles at 0
    least = max(delay or 0, 1)
    if factor == 1:
        return least
    # lag k of means of n rows holds the lags kn - n + 1 … kn + n - 1 of the rows: where the
    # response begins among these, what is not there yet is no mode. Two lags hold any beginning
    whole = least + 2 if of_rows is None else -(-(max(of_rows, 1) + factor - 1) // factor)
    # what an input does within a mean, as one that is held over some rows, blurs one lag more
    return max(whole + 1, least)


def _poles(found: Responses, begins: Mapping[int, int]) -> ComplexArray:
    """At most four poles of the state-space model with these impulse responses."""
    # half of the lags for rows, half for columns: the Hankel matrix is as square as it can be
    half = found.lags // 2
    if half < 2:
        return _NO_POLES
    columns: list[FloatArray] = []
    for number, begin in begins.items():
        series = found.values[number, begin:]
        if len(series) > half:
            columns.append(np.lib.stride_tricks.sliding_window_view(series, half).T)
    if not columns:
        return _NO_POLES
    table = np.concatenate(columns, axis=1)
    left, sizes, _ = np.linalg.svd(table)
    noise = float(np.sqrt(np.mean(found.errors[list(begins)] ** 2)))
    # the largest singular value of a matrix of independent errors (Geman 1980)
    limit = max(noise * (np.sqrt(table.shape[0]) + np.sqrt(table.shape[1])), _LEAST * sizes[0])
    # modes are as many as singular values stand out of noise
    order = min(int(np.sum(sizes > limit)), _HIGHEST_ORDER, half - 1)
    if order < 1:
        return _NO_POLES
    observed = left[:, :order]
    # rows shifted by one are the state one step later (Kung 1978)
    step = np.linalg.lstsq(observed[:-1], observed[1:], rcond=None)[0]
    poles = np.asarray(np.linalg.eigvals(step), dtype=np.complex128)
    # a mode without energy is a pole that only noise needs
    return poles[_energy(found, begins, poles) > _LEAST_ENERGY]


def _energy(found: Responses, begins: Mapping[int, int], poles: ComplexArray) -> FloatArray:
    """The energy of each mode in the responses, relative to the largest."""
    energy = np.zeros(len(poles))
    for number, begin in begins.items():
        series = found.values[number, begin:]
        # each mode is a power series; how much of the response each one is follows by least squares
        modes = poles ** np.arange(len(series))[:, None]
        shares = np.linalg.lstsq(modes, series.astype(np.complex128), rcond=None)[0]
        energy += np.sum(np.abs(modes * shares) ** 2, axis=0) / np.sum(series**2)
    return energy / np.max(energy)
