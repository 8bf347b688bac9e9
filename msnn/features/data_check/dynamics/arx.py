"""Fits a long ARX model of a series and its inputs, and detects feedback with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from msnn.data.dataset import FloatArray
from msnn.features.data_check.dynamics.pieces import Piece, rows_of

_AT_ONCE = 4096
_SMALLEST = 1e-75
"""Minimum size of a column relative to 1, so that its square has a finite reciprocal."""

_RIDGE = 1e-7
"""Ridge relative to the mean square of a regressor, like noise 70 dB below it.

It selects a small model among the long ones that fit noise-free data equally. Coefficients without
excitation become 0 with a large standard error.
"""


@dataclass(frozen=True, slots=True)
class ArxOrders:
    """Lags of the output from 1 to `own`, and of each input from `first` to `last`."""

    own: int
    last: int
    first: int = 0

    @property
    def taps(self) -> int:
        return self.last - self.first + 1

    @property
    def depth(self) -> int:
        return max(self.own, self.last)


@dataclass(frozen=True, slots=True, kw_only=True)
class Arx:
    """A(q) y = Σ Bⱼ(q) uⱼ + c + e (Ljung, System Identification, 2nd ed. 1999, §4.2)."""

    orders: ArxOrders
    denominator: FloatArray
    """Coefficients of A, beginning with 1."""
    numerators: FloatArray
    """(inputs, taps): coefficients of Bⱼ from lag `first`."""
    covariance: FloatArray
    """Covariance of −a₁ …, then of all taps, input by input."""
    residual: float
    """Standard deviation of e."""
    rows: int
    squares: float
    """Σ e²."""
    total: float
    """Σ y² of the same rows."""


def fit_arx(pieces: Sequence[Piece], orders: ArxOrders) -> Arx | None:
    """The least-squares model; None with fewer than two rows per parameter, or after overflow.

    The covariance is s² (XᵀX)⁻¹, which is correct if e is white. Normal equations are summed over
    blocks, so the memory does not depend on the number of rows.
    """
    inputs = pieces[0].inputs.shape[1] if pieces else 0
    count = orders.own + inputs * orders.taps + 1
    rows = sum(max(len(piece) - orders.depth, 0) for piece in pieces)
    if rows < 2 * count:
        return None
    gram = np.zeros((count + 1, count + 1))
    for piece in pieces:
        # blocks keep the memory at that of the numbers, whatever the record is long
        for first in range(orders.depth, len(piece), _AT_ONCE):
            table = _regressors(piece, orders, first, min(first + _AT_ONCE, len(piece)))
            gram += table.T @ table
    # columns of unlike sizes: without scales the inverse would lose their digits
    scale = np.sqrt(np.diag(gram) / rows)
    # a column that is 0 stays 0
    scale[scale == 0] = 1.0
    # variances of such columns leave the range of doubles
    if scale.min() < _SMALLEST or scale.max() > 1.0 / _SMALLEST:
        return None
    gram /= np.outer(scale, scale)
    left, right = gram[:-1, :-1], gram[:-1, -1]
    # with the ridge it has an inverse even where inputs depend on each other
    inverse = np.linalg.inv(left + _RIDGE * rows * np.eye(count))
    found = inverse @ right
    squares = float(gram[-1, -1] - 2 * right @ found + found @ left @ found)
    # Noise that the ridge stands for passes through the model to the residual. Σe², a difference
    # of large numbers, can come out below that.
    squares = max(squares, _RIDGE * rows * (1 + float(found @ found))) * scale[-1] ** 2
    variance = squares / (rows - count)
    # back to the units of the columns
    inverse *= variance / np.outer(scale[:-1], scale[:-1])
    found *= scale[-1] / scale[:-1]
    return Arx(
        orders=orders,
        denominator=np.concatenate(([1.0], -found[: orders.own])),
        numerators=found[orders.own : -1].reshape(inputs, orders.taps),
        covariance=inverse[:-1, :-1],
        residual=float(np.sqrt(variance)),
        rows=rows,
        squares=squares,
        total=float(gram[-1, -1]) * scale[-1] ** 2,
    )


def _regressors(piece: Piece, orders: ArxOrders, first: int, stop: int) -> FloatArray:
    """(stop − first, parameters + 1): past outputs, past inputs, 1, and the output itself."""
    rows = stop - first
    columns: list[FloatArray] = []
    if orders.own:
        # newest first, as polynomials in q⁻¹ count
        past = sliding_window_view(piece.output[first - orders.own : stop - 1], orders.own)
        columns.append(past[:rows, ::-1])
    for series in piece.inputs.T:
        past = sliding_window_view(series[first - orders.last : stop - orders.first], orders.taps)
        columns.append(past[:rows, ::-1])
    columns += [np.ones((rows, 1)), piece.output[first:stop, None]]
    return np.concatenate(columns, axis=1)


FALSE_ALARMS = 1e-3
"""Probability of a false detection of feedback."""
_LEAST_SHARE = 0.01
"""Minimum explained fraction of the innovation; noise and common signals explain less."""
_OWN = 40
_OTHER = 5
_ROWS_A_NUMBER = 5
_PREDICTED = 1e-5
"""Minimum relative residual of an input that its own past predicts, due to the ridge."""


def feedback(pieces: Sequence[Piece], number: int) -> float | None:
    """The fraction of the innovation of input `number` that the past output explains.

    None if the output explains nothing. Granger's test (Econometrica 37, 1969) compares two models
    of the input by its own past, one also with the past output. Without feedback, n ln(Σe²/Σe'²) is
    χ² distributed with the number of added parameters. The model uses more lags of the input than
    of the output. Otherwise a periodic input would seem to be predicted by the output, which
    depends on earlier inputs.
    """
    # turned round: the input is explained, the output explains
    turned = [Piece(piece.inputs[:, number], piece.output[:, None]) for piece in pieces]
    rows = rows_of(turned)
    # a test with few rows a number finds feedback in chance
    own = min(_OWN, rows // (4 * _ROWS_A_NUMBER))
    if own < _OTHER:
        return None
    with_output = fit_arx(turned, ArxOrders(own, _OTHER, first=1))
    alone = fit_arx(
        [Piece(piece.output, piece.inputs[:, :0]) for piece in turned], ArxOrders(own, 0)
    )
    if with_output is None or alone is None or not alone.squares > 0:
        return None
    # a periodic input is predicted by its own past up to rounding: what is left is no feedback
    if alone.squares < _PREDICTED * alone.total:
        return None
    share = 1 - with_output.squares / alone.squares
    # a share of 1 would be an infinite statistic
    statistic = -alone.rows * math.log(max(1 - share, np.finfo(np.float64).tiny))
    if share < _LEAST_SHARE or statistic < chi_square_quantile(_OTHER, FALSE_ALARMS):
        return None
    return share


def chi_square_quantile(numbers: int, chance: float) -> float:
    """The quantile that χ² exceeds with probability `chance` (Wilson and Hilferty, PNAS 17,
    1931).
    """
    part = 2 / (9 * numbers)
    return numbers * (1 - part + NormalDist().inv_cdf(1 - chance) * math.sqrt(part)) ** 3
