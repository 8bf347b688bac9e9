"""Selects the linear model of a new spec: inputs, outputs, delays, orders, rollouts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray
from msnn.features.data_check.dynamics.arx import Arx, ArxOrders, chi_square_quantile, fit_arx
from msnn.features.data_check.dynamics.impulse_response import Responses, responses, time_constants
from msnn.features.data_check.dynamics.orders import proposed_orders
from msnn.features.data_check.dynamics.pieces import Piece, pieces_of
from msnn.features.data_check.first_spec.columns import FoundColumn
from msnn.training.starts.linear_system import filtered

_AS_GOOD = 1.02
"""Minimum ratio of errors for selecting a higher order: 2 %."""
_VALIDATION = 0.2
_LONGEST_ROLLOUT = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Baseline:
    """y[t+1] = Σ aᵢ y[t−i] + Σⱼ Σᵢ bⱼᵢ uⱼ[t+1−dⱼ−i] + c, i from 0 to order − 1."""

    order: int
    delays: tuple[int, ...]
    """Rows from each input to its first effect, at least 1."""
    seen: tuple[bool, ...]
    """True if the data show the delay; otherwise it is 1."""
    immediate: tuple[bool, ...]
    """True if the effect begins in the same row, which a prediction cannot use."""
    horizon: int
    """Length of rollouts: three time constants, limited by the recordings."""
    constant_error: float
    """RMS of the last fifth of the data around the mean of the rest."""
    held_error: float
    """RMS error of the previous row as prediction."""


def choose_baseline(
    target: FoundColumn, inputs: Sequence[FoundColumn], follows: BoolArray
) -> Baseline:
    """The smallest model whose simulation of the last fifth is about as good as that of larger
    ones.
    """
    table = np.stack([c.values for c in inputs], axis=1) if inputs else np.zeros((len(follows), 0))
    pieces = pieces_of(target.values, table, follows)
    found = responses(pieces)
    delays = [None if found is None else found.delay(i) for i in range(len(inputs))]
    sharp = [found is not None and found.begins_sharply(i) for i in range(len(inputs))]
    seen = tuple(max(delay or 1, 1) for delay in delays)
    # a response that rises slowly has begun earlier, or rises after a delay
    least = tuple(delay if s else 1 for delay, s in zip(seen, sharp, strict=True))
    cut = int(len(follows) * (1 - _VALIDATION))
    tried: list[tuple[float, int, tuple[int, ...]]] = []
    # both are tried: the first effect that the responses show may be later than the true one
    for used in dict.fromkeys((least, seen)):
        delayed = table.copy()
        for column, delay in enumerate(used):
            # moved, so that one ARX form with inputs from the last row on serves all delays
            delayed[:, column] = _later(table[:, column], delay - 1)
        train = pieces_of(target.values[:cut], delayed[:cut], follows[:cut])
        tried.append((*_order(train, pieces_of(target.values, delayed, follows)), used))
    _, order, used = min(tried, key=lambda one: one[0])
    late = target.values[cut:]
    return Baseline(
        order=order,
        delays=used,
        seen=tuple(delay is not None for delay in delays),
        immediate=tuple(delay == 0 for delay in delays),
        # with the data as they are: the time constants do not depend on the delays
        horizon=_horizon(pieces, found, order + max(used, default=1), len(late)),
        constant_error=_rms(late - np.nanmean(target.values[:cut])),
        held_error=_rms(np.diff(late)),
    )


def _order(train: Sequence[Piece], pieces: Sequence[Piece]) -> tuple[float, int]:
    """The smallest order with about the minimum error, and its error."""
    errors: dict[int, float] = {}
    for order in proposed_orders(train):
        model = fit_arx(train, ArxOrders(order, order, first=1))
        # an unstable predictor may fit one step well and runs away in a rollout
        if model is not None and np.all(np.abs(np.roots(model.denominator)) < 1):
            errors[order] = sum(_simulation_error(model, piece) for piece in pieces)
    if not errors:
        return np.inf, 2
    best = min(errors.values())
    # errors are squares: 2 % of the error are 4 % of these
    return next((e, order) for order, e in errors.items() if e <= _AS_GOOD**2 * best)


def _simulation_error(model: Arx, piece: Piece) -> float:
    """Σ e² of a simulation over the last fifth of an interval, where initial values have
    decayed.
    """
    driven = np.zeros(len(piece))
    for series, taps in zip(piece.inputs.T, model.numerators, strict=True):
        # taps begin with the row before
        driven += np.convolve(series, np.concatenate(([0.0], taps)))[: len(piece)]
    late = int(len(piece) * (1 - _VALIDATION))
    error = piece.output - filtered(driven, model.denominator)
    return float(np.sum(error[late:] ** 2))


def _horizon(pieces: Sequence[Piece], found: Responses | None, past: int, late: int) -> int:
    constants = None if found is None else time_constants(pieces, found)
    wanted = 3 * constants.slowest if constants is not None else 20.0
    longest = max(map(len, pieces), default=0)
    # the validation rows must hold a rollout, the training rows several
    room = min(late - past - 1, (longest - past) // 4)
    return int(max(min(wanted, _LONGEST_ROLLOUT, room), 1))


def _later(values: FloatArray, rows: int) -> FloatArray:
    # NaN: rows whose input is not known belong to no piece
    return np.concatenate((np.full(rows, np.nan), values[: len(values) - rows]))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


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
