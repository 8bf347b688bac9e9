"""Proposes orders for a linear model, over a range that grows with the data."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from msnn.features.data_check.dynamics.arx import ArxOrders, fit_arx
from msnn.features.data_check.dynamics.pieces import Piece, rows_of

_LADDER = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40)
_ALWAYS = (1, 2, 3, 4)
_ROWS_A_NUMBER = 20
_MOST_NUMBERS = 400
_PATIENCE = 5
"""Orders without a better criterion after which the search ends."""


def proposed_orders(pieces: Sequence[Piece]) -> tuple[int, ...]:
    """Orders 1 to 4, and those that AIC and BIC choose up to 40, the smallest first.

    An ARX model has lags 1 … order of the output and of each input. With p coefficients and
    one-step errors e in n rows, AIC = n ln(Σe²/n) + 2 p (Akaike 1974) and
    BIC = n ln(Σe²/n) + p ln n (Schwarz 1978). Both compare one-step errors; the caller compares
    simulations of these orders. An order needs 20 rows per coefficient. The search ends five orders
    after both criteria have stopped falling, so that a small system takes a short search.
    """
    if not pieces:
        return _ALWAYS
    each = 1 + pieces[0].inputs.shape[1]
    most = min(rows_of(pieces) // _ROWS_A_NUMBER, _MOST_NUMBERS) // each
    best: dict[str, tuple[float, int]] = {}
    later = 0
    for order in _LADDER:
        # of the same rows: a criterion of fewer rows is another one
        if (order > most and order not in _ALWAYS) or later >= _PATIENCE:
            break
        model = fit_arx(_from_the_same_row(pieces, order, max(most, 4)), _orders(order))
        later += 1
        if model is None or not model.squares > 0:
            continue
        size = model.rows * math.log(model.squares / model.rows)
        number = order * each + 1
        for name, weight in (("aic", 2.0), ("bic", math.log(model.rows))):
            value = size + weight * number
            if name not in best or value < best[name][0]:
                best[name] = value, order
                later = 0
    return tuple(sorted({*_ALWAYS, *(order for _, order in best.values())}))


def _orders(order: int) -> ArxOrders:
    return ArxOrders(order, order, first=1)


def _from_the_same_row(pieces: Sequence[Piece], order: int, most: int) -> list[Piece]:
    """The pieces without rows that only a smaller order can predict."""
    skipped = min(most, _LADDER[-1]) - order
    return [
        Piece(piece.output[skipped:], np.ascontiguousarray(piece.inputs[skipped:]))
        for piece in pieces
        if len(piece) > skipped
    ]
