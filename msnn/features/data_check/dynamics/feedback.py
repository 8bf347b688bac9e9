"""Tells whether an input was made from the output: data of a closed loop."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from msnn.features.data_check.dynamics.arx import ArxOrders, fit_arx
from msnn.features.data_check.dynamics.chi_square import chi_square_quantile
from msnn.features.data_check.dynamics.pieces import Piece, rows_of

FALSE_ALARMS = 1e-3
"""How often feedback is claimed where there is none."""
_LEAST_SHARE = 0.01
"""Of what the input's own past leaves open: less is what noise and other signals in common do."""
_OWN = 40
_OTHER = 5
_ROWS_A_NUMBER = 5
_PREDICTED = 1e-5
"""What a model leaves of an input that its own past predicts, as the ridge of the fit limits it."""


def feedback(pieces: Sequence[Piece], number: int) -> float | None:
    """The share of input `number` that its own past leaves open and the past output explains.

    None where the output explains nothing of it. Granger's test (Econometrica 37, 1969): two models
    of the input in its past, one with the past output; n ln(Σe²/Σe'²) is χ² of the added numbers
    where there is no feedback. The input's own past is much longer than the output's, or a periodic
    input would be predicted by what the system remembers of it.
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
