"""Estimates impulse responses with confidence bands, their delays and time constants."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from msnn.data.dataset import FloatArray
from msnn.features.data_check.dynamics.arx import Arx, ArxOrders, fit_arx
from msnn.features.data_check.dynamics.distributions import f_survival
from msnn.features.data_check.dynamics.pieces import Piece, rows_of, slower

FALSE_ALARMS = 0.01
"""Probability of a false response, over all lags together."""
LONGEST_DELAY = 100
_OWN = 20
_ROWS_A_NUMBER = 5
_MOST_NUMBERS = 400
"""Maximum number of parameters per fit; the time grows quadratically."""
_SHOWN = 1e-4
"""p-value of a response that no single lag shows, from which modes are estimated."""
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

    def p_value(self, number: int) -> float:
        """The p-value of an F test that all taps of an input, the last one left out, are 0.

        It sees responses at a few lags that the groups of `influences` average. The row itself is
        left out, since a controller may have computed the input from it. The last tap is in the
        model and not in the hypothesis (Toda and Yamamoto, J. Econometrics 66, 1995).
        """
        own, taps = self.model.orders.own, self.model.orders.taps
        begin, skipped = own + number * taps, max(1 - self.model.orders.first, 0)
        used = slice(begin + skipped, begin + taps - 1)
        found = self.model.numerators[number, skipped:-1]
        if not len(found):
            return 1.0
        weighed = np.asarray(np.linalg.solve(self.model.covariance[used, used], found), float)
        ratio = float(found @ weighed) / len(found)
        freedom = self.model.rows - len(self.model.covariance) - 1
        return f_survival(ratio, len(found), freedom) if np.isfinite(ratio) else 1.0

    def shows(self, number: int) -> bool:
        """True if a lag is outside the band, or all lags together show a response."""
        return self.delay(number) is not None or self.p_value(number) < _SHOWN

    def in_row(self, number: int) -> float:
        """|Coefficient of the same row| in standard errors; 0 if the model has none."""
        orders = self.model.orders
        if orders.first > 0:
            return 0.0
        place = orders.own + number * orders.taps
        error = float(np.sqrt(self.model.covariance[place, place]))
        return abs(float(self.model.numerators[number, 0])) / error if error > 0 else 0.0

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


def responses(pieces: Sequence[Piece], first: int = 0) -> Responses | None:
    """The responses to all inputs, estimated together; None with too few rows.

    `first` is the first lag of the model. It is 1 under feedback, where a controller may compute an
    input from the output of the same row.

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
        model = fit_arx(pieces, ArxOrders(own, last, first))
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
    shifted = np.array([_later(series, orders.first + i) for i in range(orders.taps)])
    # B/A by products with the series of 1/A
    values = model.numerators @ shifted
    errors = np.zeros_like(values)
    for number, (used, table) in enumerate(_derivatives(model, values)):
        covariance = model.covariance[np.ix_(used, used)]
        squares = np.einsum("ki,ij,kj->k", table, covariance, table)
        errors[number] = np.sqrt(np.maximum(squares, 0.0))
    return values, errors


def _derivatives(model: Arx, values: FloatArray) -> Iterator[tuple[list[int], FloatArray]]:
    """For each input: places of its coefficients, and (lags, coefficients) of derivatives."""
    orders, lags = model.orders, values.shape[1]
    series = power_series(model.denominator, lags)
    # column i is the series i + 1, or i, lags later
    shifted = np.array([_later(series, orders.first + i) for i in range(orders.taps)]).T
    for number, response in enumerate(values):
        own = -np.convolve(response, series)[:lags]
        slopes = np.array([_later(own, i) for i in range(1, orders.own + 1)]).T
        begin = orders.own + number * orders.taps
        used = [*range(orders.own), *range(begin, begin + orders.taps)]
        # the covariance is that of −a, so the slopes in a change their sign
        yield used, np.concatenate((-slopes, shifted), axis=1)


def _random_errors(found: Responses, count: int) -> FloatArray:
    """Errors of all responses, drawn with their covariance; the same ones in each call."""
    model = found.model
    deviations = np.sqrt(np.diag(model.covariance))
    deviations[deviations == 0] = 1.0
    # coefficients have units of their own: scaled, or small variances would be lost
    sizes, axes = np.linalg.eigh(model.covariance / np.outer(deviations, deviations))
    root = deviations[:, None] * axes * np.sqrt(np.maximum(sizes, 0.0))
    changes = root @ np.random.default_rng(0).normal(size=(len(root), count))
    # responses of set-points are 0 and have no coefficients
    moving = np.flatnonzero(found.errors.any(axis=1))
    errors = np.zeros((count, *found.values.shape))
    tables = _derivatives(model, found.values[moving])
    for number, (used, table) in zip(moving, tables, strict=True):
        errors[:, number] = (table @ changes[used]).T
    return errors


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
_HIGHEST_ORDER = 20
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
    interval: tuple[float, float]
    """Bounds of `slowest` from random models within the errors of the fit, made twice as wide."""
    growing: bool
    """True if the slowest mode grows in all of these models: the system is unstable."""
    settling: float | None
    """Rows until a step response is within 2 %; None if it has not settled in any estimate."""

    @property
    def slowest(self) -> float:
        """The largest time constant of decay −1/ln|z|, in rows; infinite for an integrator."""
        return max(self.modes)

    @property
    def fastest(self) -> float:
        """The smallest 1/|ln z|: the scale of the fastest motion in rows."""
        return min(self.natural)

    @property
    def has_range(self) -> bool:
        """True if `interval` is wider than the errors of the method itself."""
        low, high = self.interval
        return math.isinf(high) or high - low > _RESOLUTION * low

    @property
    def integrates(self) -> bool:
        """True if the data do not exclude that the slowest mode never decays."""
        return math.isinf(self.interval[1])

    @property
    def damping(self) -> tuple[float, ...]:
        """The damping ratio of each mode, 1 without oscillation, at most 0 without decay."""
        pairs = zip(self.natural, self.modes, strict=True)
        return tuple(natural / mode if math.isfinite(mode) else 0.0 for natural, mode in pairs)


def time_constants(pieces: Sequence[Piece], first: Responses) -> TimeConstants | None:
    """The modes of a series, from its responses to all inputs; None if none is visible.

    If responses are longer than the estimated lags, the estimate is repeated with means of 4, 16, …
    rows; fast modes keep their first estimates. A state-space model follows from the Hankel matrix
    of the responses, shifted by one lag (Kung 1978). Its order is the number of singular values
    above the effect of the responses' errors. The responses come from a long model, whose poles are
    not biased by noise as those of a short ARX model are.
    """
    # responses that last longer than the lags are seen at fewer rows a second
    found, factor = first, 1
    while True:
        seen = [i for i in range(len(found.values)) if found.shows(i)]
        if not seen:
            return None
        settled = [found.settled(i) for i in seen]
        if all(lag is not None for lag in settled):
            break
        factor *= _SLOWER
        fewer = slower(pieces, factor)
        again = (
            responses(fewer, first.model.orders.first) if rows_of(fewer) >= _FEWEST_ROWS else None
        )
        # too few rows, or nothing visible any more: the estimate before stays
        if again is None or not any(again.shows(i) for i in range(len(again.values))):
            factor //= _SLOWER
            break
        found = again
    begins = {i: _begin(found.delay(i), first.delay(i), factor) for i in seen}
    slow_poles = _poles(found, begins)
    constants, periods, natural = factor * _times(slow_poles)
    # the estimate that gives each mode: responses, beginnings, poles, number of the pole
    sources = [(found, begins, slow_poles, i) for i in range(len(slow_poles))]
    if factor > 1:
        # means say nothing of what is over within one of them, the rows do
        told = [(i, first.delay(i)) for i in seen if first.shows(i)]
        begins_of_rows = {i: _begin(delay, delay, 1) for i, delay in told}
        fast_poles = _poles(first, begins_of_rows)
        rows = _times(fast_poles)
        slow, fast = natural >= factor, rows[2] < factor
        sources = [source for source, is_slow in zip(sources, slow, strict=True) if is_slow]
        sources += [(first, begins_of_rows, fast_poles, int(i)) for i in np.flatnonzero(fast)]
        parts = zip((constants, periods, natural), rows, strict=True)
        constants, periods, natural = (np.concatenate([a[slow], b[fast]]) for a, b in parts)
    if not len(natural):
        return None
    if factor == 1 and rows_of(pieces) < _FEWEST_ROWS and np.max(natural) > found.lags:
        return None  # longer than all that was seen of it
    order = np.argsort(-constants, kind="stable")
    lags = [lag for lag in settled if lag is not None]
    slowest = float(np.max(constants))
    # of several that never decay, the one that grows fastest
    slowest_of = [i for i, constant in enumerate(constants) if constant == slowest]
    source = max((sources[i] for i in slowest_of), key=lambda one: abs(one[2][one[3]]))
    interval, growing = _interval(*source, factor if source[0] is found else 1)
    # a range as wide as that says nothing; of an integrator the lags seen are the scale
    if interval[0] < (slowest if math.isfinite(slowest) else factor * found.lags) / _WIDEST:
        return None
    return TimeConstants(
        modes=tuple(constants[order].tolist()),
        periods=tuple(periods[order].tolist()),
        natural=tuple(natural[order].tolist()),
        interval=(min(interval[0], slowest), max(interval[1], slowest)),
        growing=growing,
        settling=float(max(lags) * factor) if len(lags) == len(settled) else None,
    )


_DRAWS = 40
_RESOLUTION = 1e-3
"""Minimum relative width of a range; rounding and truncation of the model exceed smaller ones."""
_WIDEST = 4.0
"""A slowest time constant with a lower bound below this part of it is not told."""
_OUTSIDE = 0.025
_WIDER = 2.0
"""Factor on the spread of the draws, chosen by simulation (benchmarks/data/true_claims.md).

A long model fitted to noise of other kinds has larger errors than its covariance says.
"""


def _interval(
    found: Responses, begins: Mapping[int, int], poles: ComplexArray, number: int, factor: int
) -> tuple[tuple[float, float], bool]:
    """Bounds of the time constant of pole `number`, in rows, and whether it grows for certain.

    Errors of the responses are drawn with their covariance. Of each draw, the pole nearest to this
    one is taken. Their spread is put around the estimate itself: noise that is added twice moves
    the median of the draws.
    """
    slowest = poles[number]
    size = float(np.abs(slowest))
    drawn: list[float] = []
    for errors in _random_errors(found, _DRAWS):
        near = _poles(replace(found, values=found.values + errors), begins, len(poles))
        if len(near):
            drawn.append(float(np.abs(near[np.argmin(np.abs(near - slowest))])))
    if len(drawn) < _DRAWS // 2:
        return (0.0, math.inf), False
    low, high = np.quantile(drawn, [_OUTSIDE, 1 - _OUTSIDE]) - np.median(drawn)
    low, high = size + _WIDER * min(low, 0.0), size + _WIDER * max(high, 0.0)
    bounds = factor * _times(np.array([max(low, 1e-12), high], np.complex128))[0]
    return (float(bounds[0]), float(bounds[1])), bool(low > 1)


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


def _poles(found: Responses, begins: Mapping[int, int], order: int | None = None) -> ComplexArray:
    """The poles of the state-space model with these impulse responses, of at most `order`."""
    # half of the lags for rows, half for columns: the Hankel matrix is as square as it can be
    half = found.lags // 2
    if half < 2:
        return _NO_POLES
    table = _hankel(found.values, begins, half)
    if table is None:
        return _NO_POLES
    left, sizes, _ = np.linalg.svd(table, full_matrices=False)
    # modes are as many as singular values stand out of noise
    if order is None:
        order = int(np.sum(sizes > max(_noise(found, begins), _LEAST * sizes[0])))
    order = min(order, _HIGHEST_ORDER, half - 1)
    if order < 1:
        return _NO_POLES
    observed = left[:, :order]
    # rows shifted by one are the state one step later (Kung 1978)
    step = np.linalg.lstsq(observed[:-1], observed[1:], rcond=None)[0]
    poles = np.asarray(np.linalg.eigvals(step), dtype=np.complex128)
    # a mode without energy is a pole that only noise needs
    return poles[_energy(found, begins, poles) > _LEAST_ENERGY]


def _hankel(values: FloatArray, begins: Mapping[int, int], half: int) -> FloatArray | None:
    """(half, columns): the responses from their beginnings on, shifted by one lag per row."""
    columns = [
        np.lib.stride_tricks.sliding_window_view(values[number, begin:], half).T
        for number, begin in begins.items()
        if values.shape[1] - begin > half
    ]
    return np.concatenate(columns, axis=1) if columns else None


_NOISE_DRAWS = 12


def _noise(found: Responses, begins: Mapping[int, int]) -> float:
    """The largest singular value that errors alone give the Hankel matrix, in most draws.

    Errors of neighbouring lags are correlated where an input is held over several rows.
    """
    tables = [
        _hankel(errors, begins, found.lags // 2) for errors in _random_errors(found, _NOISE_DRAWS)
    ]
    return max(float(np.linalg.norm(table, 2)) for table in tables if table is not None)


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
