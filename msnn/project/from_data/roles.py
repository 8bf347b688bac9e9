"""Tells which columns look like inputs of a system and which like its outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import BoolArray
from msnn.data_check.dynamics.arx import Orders, fit_arx
from msnn.data_check.dynamics.pieces import Piece, pieces_of
from msnn.project.from_data.columns import FoundColumn

_LAGS = 5
_LEAST_SHARE = 0.05
"""Of what a column's own past leaves open: an output has more of it from the past of others."""


@dataclass(frozen=True, slots=True)
class Role:
    """How much of what is new in a column the past of others explains."""

    column: FoundColumn
    explained: float

    @property
    def output(self) -> bool:
        return self.explained > _LEAST_SHARE


def roles_of(
    columns: Sequence[FoundColumn], follows: BoolArray, without: FoundColumn | None = None
) -> list[Role]:
    """The role of each column; the column `without` may explain nothing, as what is predicted."""
    return [Role(column, _explained(column, columns, follows, without)) for column in columns]


def _explained(
    column: FoundColumn,
    columns: Sequence[FoundColumn],
    follows: BoolArray,
    without: FoundColumn | None,
) -> float:
    others = [c.values for c in columns if c is not column and c is not without]
    if not others or _stands_still(column):
        return 0.0
    pieces = pieces_of(column.values, np.stack(others, axis=1), follows)
    with_others = fit_arx(pieces, Orders(_LAGS, _LAGS, first=1))
    alone = fit_arx([Piece(p.output, p.inputs[:, :0]) for p in pieces], Orders(_LAGS, 0))
    if with_others is None or alone is None or not alone.squares > 0:
        return 0.0
    return max(1 - with_others.squares / alone.squares, 0.0)


def _stands_still(column: FoundColumn) -> bool:
    """Whether most rows repeat the one before: a command that is held."""
    return float(np.nanmedian(np.abs(np.diff(column.values)))) == 0
