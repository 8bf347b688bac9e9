"""Estimates impulse responses with confidence bands, their delays and time constants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from msnn.data.dataset import FloatArray
from msnn.features.data_check.dynamics.arx import Arx, ArxOrders, fit_arx
from msnn.features.data_check.dynamics.pieces import Piece, rows_of, slower

FALSE_ALARMS = 0.01
"""Probability of a false response, over all lags together."""
LONGEST_DELAY = 100
_OWN = 20
_ROWS_A_NUMBER = 5
_MOST_NUMBERS = 400
"""Maximum number of parameters per fit; the time grows quadratically."""
_SHARPNESS = 3.0
"""Factor by which a response must exceed the band to count as a sharp beginning."""
_SHARE_AT_ONCE = 0.1
"""Relative response in the same row that sampling and holding of inputs may cause."""
_NEGLIGIBLE = 0.01
"""Relative response that a nonlinear system may cause in a linear model."""


@dataclass(frozen=True, slots=True)
class Responses:
    """Responses of one series to an impulse at each input; (inputs, lags), from lag 0."""

    values: FloatArray
    errors: FloatArray
    """Standard errors."""
    factor: float
    """Half the width of the band, in standard errors."""
    model: Arx

    @property
    def lags(self) -> int:
        return self.values.shape[1]

    def delay(self, number: int) -> int | None:
        """The first lag outside the band; None without a visible response."""
        values = np.abs(self.values[number])
        least = np.maximum(self.factor * self.errors[number], _NEGLIGIBLE * values.max())
        beyond = np.flatnonzero(values > least)
        # the first beyond the band, and beyond what a linear model leaves of another one
        return int(beyond[0]) if len(beyond) else None

    def answers(self, number: int) -> bool:
        """True if all taps of an input together differ from 0 (F test).

        For an input that is constant for long times, no single lag may be outside the band. F is
        transformed to a normal variable (Paulson, Annals of Mathematical Statistics 13, 1942).
        """
        own, taps = self.model.orders.own, self.model.orders.taps
        used = slice(own + number * taps, own + (number + 1) * taps)
        found = self.model.numerators[number]
        weighed = np.asarray(np.linalg.solve(self.model.covariance[used, used], found), float)
        ratio = float(found @ weighed) / taps
        if not ratio > 0:
            return False
        left = 2 / (9 * (self.model.rows - len(self.model.covariance) - 1))
        right, root = 2 / (9 * taps), ratio ** (1 / 3)
        normal = ((1 - left) * root - (1 - right)) / np.sqrt(left * root**2 + right)
        return bool(normal > NormalDist().inv_cdf(1 - FALSE_ALARMS))

    def begins_sharply(self, number: int) -> bool:
        """True if the response begins at the delay, so that no earlier response can be hidden.

        A slowly rising response may have begun earlier; its delay is then an upper limit.
        """
        delay = self.delay(number)
        if delay is None:
            return False
        values = np.abs(self.values[number])
        if delay == 0:
            return bool(values[0] > _SHARE_AT_ONCE * values.max())
        hidden = self.factor * self.errors[number, :delay].max()
        return bool(values[delay] > _SHARPNESS * hidden)

    def settled(self, number: int, share: float = 0.02) -> int | None:
        """The lag after which the step response stays within a fraction of its span.

        None if it has not settled at the last estimated lag.
        """
        step = np.cumsum(self.values[number])
        # the response to a step is the sum of that to an impulse
        off = np.abs(step - step[-1]) > share * np.ptp(step)
        last = int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
        # near the end of the lags settling cannot be told from the end of the estimate
        return last if last < 0.8 * self.lags else None


def responses(pieces: Sequence[Piece]) -> Responses | None:
    """The responses to all inputs, estimated together; None with too few rows.

    A long model A(q) y = Σ Bⱼ(q) uⱼ + e whitens the residuals for any spectra of noise and inputs.
    This generalises the prewhitening of Box and Jenkins (Time Series Analysis, 1970, §11.2) to
    several inputs. gⱼ = Bⱼ/A, and its standard errors follow from those of A and B by the delta
    method: ∂g[k]/∂bᵢ = s[k−i] and ∂g[k]/∂aᵢ = −(g∗s)[k−i], with the power series s of 1/A. The band
    holds for all lags together (Šidák).
    """
    rows = rows_of(pieces)
    inputs = pieces[0].inputs.shape[1] if pieces else 0
    # rows a number, and a bound on the time of a fit
    numbers = min(rows // _ROWS_A_NUMBER, _MOST_NUMBERS)
    model, last = None, 0
    while model is None:
        own = min(_OWN, numbers // 4)
        # each input has as many numbers: many inputs have short responses
        last = min(LONGEST_DELAY, (numbers - own) // max(inputs, 1) - 2)
        if last < 1 or own < 1:
            return None
        model = fit_arx(pieces, ArxOrders(own, last))
        # many rows in short pieces: a model as short as a piece, if one is long enough to see it
        is_short = max(map(len, pieces)) < ROWS_OF_A_PIECE * max(inputs, 1)
        numbers = 0 if is_short else numbers // 2
    # a band for all lags together (Šidák): each lag takes the (n+1)-th root of the confidence
    quantile = NormalDist().inv_cdf(0.5 + 0.5 * (1 - FALSE_ALARMS) ** (1 / (last + 1)))
    # Student's t by its first term beyond the normal one (Abramowitz and Stegun 26.7.5)
    quantile += (quantile**3 + quantile) / (4 * (model.rows - len(model.covariance)))
    values, errors = _with_errors(model, last + 1)
    return Responses(values, errors, quantile, model)


def _with_errors(model: Arx, lags: int) -> tuple[FloatArray, FloatArray]:
    orders = model.orders
    series = power_series(model.denominator, lags)
    # column i is the series i + 1, or i, lags later
    shifted = np.array([_later(series, i) for i in range(orders.taps)]).T
    # B/A by products with the series of 1/A
    values = model.numerators @ shifted.T
    errors = np.zeros_like(values)
    for number, response in enumerate(values):
        own = -np.convolve(response, series)[:lags]
        slopes = np.array([_later(own, i) for i in range(1, orders.own + 1)]).T
        begin = orders.own + number * orders.taps
        used = [*range(orders.own), *range(begin, begin + orders.taps)]
        # the covariance is that of −a, so the slopes in a change their sign
        table = np.concatenate((-slopes, shifted), axis=1)
        covariance = model.covariance[np.ix_(used, used)]
        squares = np.einsum("ki,ij,kj->k", table, covariance, table)
        errors[number] = np.sqrt(np.maximum(squares, 0.0))
    return values, errors


def power_series(denominator: FloatArray, count: int) -> FloatArray:
    """The first coefficients of the power series of 1/A."""
    found = np.zeros(count)
    found[0] = 1.0
    for n in range(1, count):
        reach = min(n, len(denominator) - 1)
        # A s = 1: each element follows from those before
        found[n] = -denominator[1 : reach + 1] @ found[n - reach : n][::-1]
    return found


def _later(series: FloatArray, lags: int) -> FloatArray:
    # of a series that is shorter than the lags nothing is left
    return np.concatenate((np.zeros(lags), series))[: len(series)]


ComplexArray = NDArray[np.complex128]

_NO_POLES: ComplexArray = np.zeros(0, np.complex128)
_HIGHEST_ORDER = 4
_LEAST = 0.03
"""Singular values below this fraction of the largest are neglected."""
_SLOWER = 4
_FEWEST_ROWS = 200
ROWS_OF_A_PIECE = 30
"""Rows without gap per input that suffice for an estimate."""
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
