"""Detects feedback from the output to an input: data recorded in closed loop."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from msnn.features.data_check.dynamics.arx import ArxOrders, fit_arx
from msnn.features.data_check.dynamics.chi_square import chi_square_quantile
from msnn.features.data_check.dynamics.pieces import Piece, rows_of

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
