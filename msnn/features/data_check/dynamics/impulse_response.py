"""Estimates impulse responses with confidence bands, and the delays in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.features.data_check.dynamics.arx import Arx, ArxOrders, fit_arx
from msnn.features.data_check.dynamics.pieces import Piece, rows_of

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
    own = min(_OWN, numbers // 4)
    # each input has as many numbers: many inputs have short responses
    last = min(LONGEST_DELAY, (numbers - own) // max(inputs, 1) - 2)
    if last < 1 or own < 1:
        return None
    model = fit_arx(pieces, ArxOrders(own, last))
    if model is None:
        return None
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
