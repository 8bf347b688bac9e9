"""Classifies columns as likely inputs or outputs of a system."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import BoolArray
from msnn.features.data_check.dynamics.arx import Arx, ArxOrders, fit_arx
from msnn.features.data_check.dynamics.chi_square import chi_square_quantile
from msnn.features.data_check.dynamics.pieces import Piece, pieces_of
from msnn.features.data_check.first_spec.columns import FoundColumn

_LAGS = 5
_LEAST_SHARE = 0.02
_CHANCE = 1e-3
_COMPUTED = 0.5
"""Fraction of the innovation explained in the same row, typical for computed control signals."""


@dataclass(frozen=True, slots=True)
class ColumnRole:
    """The fraction of a column's innovation explained by the past of the others."""

    column: FoundColumn
    explained: float
    output: bool
    """True if this is significant, and the column is not computed from others in the same row."""


def roles_of(
    columns: Sequence[FoundColumn], follows: BoolArray, without: FoundColumn | None = None
) -> list[ColumnRole]:
    """The role of each column; the column `without` is not used as an explanation.

    An output depends on the past of other columns (Granger's test). So does a control signal,
    because it follows the output, but most of its innovation is explained in the same row.
    """
    return [_role(column, columns, follows, without) for column in columns]


def _role(
    column: FoundColumn,
    columns: Sequence[FoundColumn],
    follows: BoolArray,
    without: FoundColumn | None,
) -> ColumnRole:
    others = [c for c in columns if c is not column]
    if not others or _stands_still(column):
        return ColumnRole(column, 0.0, output=False)
    past = _left(column, [c for c in others if c is not without], follows, first=1)
    alone = _left(column, [], follows, first=1)
    if past is None or alone is None:
        return ColumnRole(column, 0.0, output=False)
    share = max(1 - past.squares / alone.squares, 0.0)
    # likelihood ratio n ln(RSS₁ / RSS₂), χ² with as many degrees of freedom as taps that were added
    statistic = -alone.rows * math.log(max(1 - share, 1e-300))
    seen = share > _LEAST_SHARE and statistic > chi_square_quantile(_LAGS * len(others), _CHANCE)
    # with `without` again: a command is computed of the output that is to be predicted
    both = _left(column, others, follows, first=1)
    same_row = _left(column, others, follows, first=0)
    computed = False
    if both is not None and same_row is not None:
        computed = 1 - same_row.squares / both.squares > _COMPUTED
    return ColumnRole(column, share, output=seen and not computed)


def _left(
    column: FoundColumn, others: Sequence[FoundColumn], follows: BoolArray, *, first: int
) -> Arx | None:
    """A model of a column from its own past and that of others, from lag `first`."""
    table = np.zeros((len(follows), len(others)))
    for number, other in enumerate(others):
        table[:, number] = other.values
    pieces: list[Piece] = pieces_of(column.values, table, follows)
    return fit_arx(pieces, ArxOrders(_LAGS, _LAGS, first=first))


def _stands_still(column: FoundColumn) -> bool:
    """True if most rows repeat the previous one, like a held command."""
    # its jumps follow no past of anything, and would pass the test by chance
    known = column.values[np.isfinite(column.values)]
    return float(np.median(np.abs(np.diff(known)))) == 0
