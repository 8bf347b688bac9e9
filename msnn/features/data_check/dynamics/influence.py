"""Tests whether one series responds to an input at all, jointly over many lags."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from msnn.data.dataset import FloatArray, IntArray
from msnn.features.data_check.dynamics.distributions import f_survival
from msnn.features.data_check.dynamics.pieces import Piece, rows_of

SIGNIFICANCE = 0.01
"""A response counts as seen below this p-value."""
LIMITED = 0.2
"""Above this bound on the static effect, relative to the target, a recording decides nothing."""
_OWN = 20
_SINGLE = 8
"""Lags of the other inputs that have a coefficient each; beyond, groups of lags have one."""
_LONGEST = 100
_ROWS_A_NUMBER = 4
_RIDGE = 1e-9
_SMALLEST = 1e-75
_DETERMINED = 1e6
"""An input with 10⁻⁶ of its variance left by the others, or less, cannot be tested."""
_AT_ONCE = 4096
_TWO_SIDED = 1.96


@dataclass(frozen=True, slots=True, kw_only=True)
class Influence:
    """The joint test of one input: does its past help to predict the target?"""

    p_value: float
    """Probability of a test statistic this large if the input has no influence."""
    lags: int
    """The test covers the lags 1 … `lags`."""
    static: float
    """Upper limit (about 97.5 %) of |static gain| · std(input) / std(target)."""

    @property
    def seen(self) -> bool:
        return self.p_value < SIGNIFICANCE

    @property
    def limited(self) -> bool:
        """True if the recording cannot exclude a static effect worth modelling."""
        return not self.static < LIMITED


def influences(pieces: Sequence[Piece]) -> tuple[Influence | None, ...]:
    """The test of every input; None where too few rows or no motion allow one.

    The target is explained by its own past, by the past of all inputs, and a constant:
    y[t] = Σ aᵢ y[t−i] + Σⱼ Σ_g bⱼ,g mean(uⱼ over the lags of group g) + c + e. The groups of the
    tested input are the lags 1, 2, 3–4, 5–8, … up to 100: few coefficients see slow responses,
    which no single lag shows. Its last group is in the model and not in the hypothesis, which keeps
    the distribution right for inputs and targets that drift (Toda and Yamamoto, J. Econometrics 66,
    1995). Row t of the inputs is left out: a controller may have computed it from y[t]. So the test
    is Granger's (Econometrica 37, 1969), and holds under feedback.

    The p-value is the larger of those of an F test and of a Wald test with White's covariance,
    which allows a variance of e that changes (Econometrica 48, 1980). Both assume that 20 past
    values of y whiten e. A response within the row itself is not part of this test.
    """
    inputs = pieces[0].inputs.shape[1] if pieces else 0
    rows = rows_of(pieces)
    own = min(_OWN, rows // 20)
    longest = min(_LONGEST, max(map(len, pieces), default=0) // 5)
    if not inputs or own < 1 or longest < 4:
        return (None,) * inputs
    return tuple(_tested(pieces, number, own, longest) for number in range(inputs))


def groups(longest: int, single: int = 2) -> list[tuple[int, int]]:
    """First and last lag of each group: `single` groups of one lag, then each twice as long."""
    found = [(lag, lag) for lag in range(1, min(single, longest) + 1)]
    first, size = found[-1][1] + 1, max(single, 1)
    while first <= longest:
        last = min(first + size - 1, longest)
        found.append((first, last))
        first, size = last + 1, 2 * size
    return found


def _tested(pieces: Sequence[Piece], number: int, own: int, longest: int) -> Influence | None:
    inputs = pieces[0].inputs.shape[1]
    lags = [groups(longest, _SINGLE if other != number else 2) for other in range(inputs)]
    order = [number, *(other for other in range(inputs) if other != number)]
    rows = _rows_after(pieces, max(longest, own))
    count = own + sum(map(len, lags)) + 1
    while rows < _ROWS_A_NUMBER * count and len(order) > 1 and longest > 4:
        # many inputs and few rows: fewer groups for the others
        longest = max(longest // 2, 4)
        lags = [groups(longest)] * inputs
        count = own + sum(map(len, lags)) + 1
        rows = _rows_after(pieces, max(longest, own))
    if rows < _ROWS_A_NUMBER * count:
        return None
    columns = [(other, first, last) for other in order for first, last in lags[other]]
    depth = max(own, longest)
    blocks = [
        (piece, first, min(first + _AT_ONCE, len(piece)))
        for piece in pieces
        for first in range(depth, len(piece), _AT_ONCE)
    ]
    gram = np.zeros((count + 1, count + 1))
    for block in blocks:
        table = _table(*block, columns, own)
        gram += table.T @ table
    size = np.sqrt(np.diag(gram) / rows)
    if size[-1] == 0 or size[size > 0].min() < _SMALLEST or size.max() > 1 / _SMALLEST:
        return None
    moves = size > 0
    tested = np.arange(len(lags[number]) - 1) if len(lags[number]) > 1 else np.arange(1)
    if not moves[tested].any():
        return None
    scale = np.where(moves, size, 1.0)
    gram /= np.outer(scale, scale)
    inverse = np.linalg.inv(gram[:-1, :-1] + _RIDGE * rows * np.eye(count))
    bread: FloatArray = np.asarray(inverse, dtype=np.float64)
    found = bread @ gram[:-1, -1]
    squares = float(gram[-1, -1] - 2 * gram[:-1, -1] @ found + found @ gram[:-1, :-1] @ found)
    squares = max(squares, _RIDGE * rows * (1 + float(found @ found)))
    meat = np.zeros_like(bread)
    for block in blocks:
        table = _table(*block, columns, own) / scale
        weighed = table[:, :-1] * (table[:, -1] - table[:, :-1] @ found)[:, None]
        meat += weighed.T @ weighed
    # what of the tested columns the others do not determine: nothing of it, and nothing is tested
    least = float(np.linalg.eigvalsh(bread[np.ix_(tested, tested)])[0])
    if not least * rows < _DETERMINED:
        return None
    freedom = rows - count
    plain: FloatArray = bread * (squares / freedom)
    robust: FloatArray = bread @ meat @ bread * (rows / freedom)
    p_value = max(_p_value(found, each, tested, freedom) for each in (plain, robust))
    # static gain Σb/(1 − Σa) of the scaled columns, back to deviations of input and target
    taps, past = np.arange(len(lags[number])), np.arange(count - 1 - own, count - 1)
    weights = scale[-1] / scale[:-1]
    above, below = float(found[taps] @ weights[taps]), 1 - float(found[past] @ weights[past])
    slopes = np.zeros(count)
    slopes[taps], slopes[past] = weights[taps] / below, above * weights[past] / below**2
    error = math.sqrt(max(float(slopes @ plain @ slopes), 0.0))
    of_input = np.sqrt(np.mean(np.concatenate([p.inputs[:, number] for p in pieces]) ** 2))
    limit = (abs(above / below) + _TWO_SIDED * error) * of_input / scale[-1]
    # 1 − Σa of an integrator is 0 within its error: it has no static gain
    doubt = math.sqrt(max(float(weights[past] @ plain[np.ix_(past, past)] @ weights[past]), 0.0))
    known = below > 2 * _TWO_SIDED * doubt
    return Influence(
        p_value=p_value,
        lags=lags[number][-1][1],
        static=float(limit) if known and math.isfinite(limit) else math.inf,
    )


def _rows_after(pieces: Sequence[Piece], depth: int) -> int:
    return sum(max(len(piece) - depth, 0) for piece in pieces)


def _table(
    piece: Piece, first: int, stop: int, columns: Sequence[tuple[int, int, int]], own: int
) -> FloatArray:
    """(stop − first, parameters + 1): groups of past inputs, past outputs, 1, the output."""
    rows = stop - first
    table = np.empty((rows, len(columns) + own + 2))
    for place, (number, begin, end) in enumerate(columns):
        series = piece.inputs[first - end : stop - begin, number]
        if begin == end:
            table[:, place] = series
        else:
            table[:, place] = sliding_window_view(series, end - begin + 1).mean(axis=1)
    past = sliding_window_view(piece.output[first - own : stop - 1], own)
    table[:, len(columns) : -2] = past[:rows, ::-1]
    table[:, -2] = 1.0
    table[:, -1] = piece.output[first:stop]
    return table


def _p_value(found: FloatArray, covariance: FloatArray, tested: IntArray, freedom: int) -> float:
    """Wald's test that all `tested` coefficients are 0, without directions of no variance."""
    sizes, axes = np.linalg.eigh(covariance[np.ix_(tested, tested)])
    kept = sizes > 1e-12 * sizes[-1]
    if not kept.any() or sizes[-1] <= 0:
        return 1.0
    along = axes[:, kept].T @ found[tested]
    numbers = int(kept.sum())
    ratio = float(np.sum(along**2 / sizes[kept])) / numbers
    return f_survival(ratio, numbers, freedom) if math.isfinite(ratio) else 1.0
