"""Fits linear difference equations by least squares, and simulates them freely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from msnn.data.dataset import BoolArray, FloatArray

_AT_ONCE = 4096
_SMALLEST = 1e-10
"""Singular values below this fraction of the largest count as 0: dependent columns."""
_ROWS_A_WEIGHT = 4
"""Minimum number of rows per weight."""
_MOST_WORK = 4e10
"""Maximum rows · weights² of a fit, some seconds."""
_SIMULATED = 20_000
"""Maximum number of rows that are simulated before the first scored row, and scored."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedRows:
    """Recordings side by side: series (rows, columns), the targets first."""

    table: FloatArray
    targets: int
    follows: BoolArray
    """True for a row one sample after the previous one."""
    held_out: BoolArray
    """True for the last rows of each recording, which no fit uses."""

    def intervals(self, *, fitted: bool) -> list[slice]:
        """The maximal intervals of consecutive rows without missing values."""
        known = np.asarray(np.isfinite(self.table).all(axis=1), np.bool_)
        if fitted:
            known = known & ~self.held_out
        before = np.concatenate(([False], known[:-1]))
        starts = np.flatnonzero(known & ~(before & self.follows))
        after = np.concatenate((known[1:] & self.follows[1:], [False]))
        stops = np.flatnonzero(known & ~after) + 1
        return [slice(a, b) for a, b in zip(starts.tolist(), stops.tolist(), strict=True)]


@dataclass(frozen=True, slots=True)
class ArxTerm:
    """Taps of one series, from lag `first` on."""

    column: int
    first: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ArxEquation:
    """yₖ[t] = Σⱼ Σᵢ taps[j, i] · seriesⱼ[t − firstⱼ − i] + offset."""

    terms: tuple[ArxTerm, ...]
    taps: FloatArray
    """(terms, order), the newest sample first."""
    offset: float

    @property
    def order(self) -> int:
        return self.taps.shape[1]

    @property
    def depth(self) -> int:
        """The largest lag."""
        return max(term.first for term in self.terms) + self.order - 1

    def rounded(self, digits: int) -> ArxEquation:
        """The same with weights of so many significant digits."""
        taps = np.array([[float(f"{x:.{digits}g}") for x in row] for row in self.taps])
        return replace(self, taps=taps, offset=float(f"{self.offset:.{digits}g}"))

    def one_step(self, rows: FittedRows) -> FloatArray:
        """(rows,): the prediction from measured values; NaN without its lags."""
        found = np.full(len(rows.table), np.nan)
        for part in rows.intervals(fitted=False):
            if part.stop - part.start > self.depth:
                whole = slice(part.start + self.depth, part.stop)
                found[whole] = _regressors(rows.table, self.terms, self.order, whole) @ np.append(
                    self.taps.ravel(), self.offset
                )
        return found


def fit(rows: FittedRows, target: int, terms: Sequence[ArxTerm], order: int) -> ArxEquation | None:
    """The least-squares equation of a target; None with too few rows or too many weights.

    min Σ e² over the rows that are not held out, by QR decomposition of blocks of rows and a
    pseudo-inverse: weights of dependent columns are the smallest ones.
    """
    depth = max(term.first for term in terms) + order - 1
    count = len(terms) * order + 1
    parts = [p for p in rows.intervals(fitted=True) if p.stop - p.start > depth]
    total = sum(p.stop - p.start - depth for p in parts)
    if total < _ROWS_A_WEIGHT * count or total * count**2 > _MOST_WORK:
        return None
    # about the mean: levels would cost digits
    centre = np.mean(np.concatenate([rows.table[p] for p in parts]), axis=0)
    scale = np.std(np.concatenate([rows.table[p] for p in parts]), axis=0)
    scale[scale == 0] = 1.0
    table = (rows.table - centre) / scale
    triangle: FloatArray = np.zeros((0, count + 1))
    for part in parts:
        for first in range(part.start + depth, part.stop, _AT_ONCE):
            some = slice(first, min(first + _AT_ONCE, part.stop))
            block = _regressors(table, terms, order, some)
            block = np.concatenate((block, table[some, target, None]), axis=1)
            stacked = np.concatenate((triangle, block))
            triangle = np.asarray(np.linalg.qr(stacked, mode="r"), np.float64)
    found = np.linalg.lstsq(triangle[:, :-1], triangle[:, -1], rcond=_SMALLEST)[0]
    columns = [term.column for term in terms]
    taps = found[:-1].reshape(len(terms), order) * (scale[target] / scale[columns])[:, None]
    offset = found[-1] * scale[target] + centre[target] - taps.sum(axis=1) @ centre[columns]
    return ArxEquation(terms=tuple(terms), taps=taps, offset=float(offset))


def _regressors(table: FloatArray, terms: Sequence[ArxTerm], order: int, rows: slice) -> FloatArray:
    """(rows, terms · order + 1): the lags of each series, the newest first, and 1."""
    columns: list[FloatArray] = []
    for term in terms:
        first, last = rows.start - term.first - order + 1, rows.stop - term.first
        past = sliding_window_view(table[first:last, term.column], order)
        columns.append(past[:, ::-1])
    return np.concatenate([*columns, np.ones((rows.stop - rows.start, 1))], axis=1)


def largest_pole(equations: Sequence[ArxEquation]) -> float:
    """The spectral radius of the simulated system: below 1, errors decay."""
    order, size = equations[0].order, len(equations)
    first = _feedback(equations)
    shift = np.eye(size * (order - 1), size * order)
    poles = np.asarray(np.linalg.eigvals(np.concatenate((first, shift))), np.complex128)
    return float(np.max(np.abs(poles)))


def _feedback(equations: Sequence[ArxEquation]) -> FloatArray:
    """(targets, order · targets): weights of past targets, the newest row first."""
    size = len(equations)
    found = np.zeros((size, equations[0].order, size))
    for number, equation in enumerate(equations):
        for term, taps in zip(equation.terms, equation.taps, strict=True):
            if term.column < size:
                found[number, :, term.column] = taps
    return found.reshape(size, -1)


def free_run(rows: FittedRows, equations: Sequence[ArxEquation]) -> FloatArray:
    """(rows, targets): the simulation of each interval from its first rows; NaN elsewhere.

    Only the rows around the held-out ones are simulated where recordings are long.
    """
    size, order = len(equations), equations[0].order
    depth = max(equation.depth for equation in equations)
    past = _feedback(equations)
    found = np.full((len(rows.table), size), np.nan)
    left = _SIMULATED
    for part in rows.intervals(fitted=False):
        scored = np.flatnonzero(rows.held_out[part])
        if part.stop - part.start <= depth or not len(scored) or left <= 0:
            continue
        begin = max(part.start, part.start + int(scored[0]) - _SIMULATED)
        stop = min(part.stop, part.start + int(scored[0]) + left)
        if stop - begin <= depth:
            continue
        left -= stop - begin
        steps = slice(begin + depth, stop)
        driven = np.zeros((stop - begin - depth, size))
        for number, equation in enumerate(equations):
            driven[:, number] = equation.offset
            inputs = [i for i, term in enumerate(equation.terms) if term.column >= size]
            if inputs:
                terms = [equation.terms[i] for i in inputs]
                table = _regressors(rows.table, terms, order, steps)[:, :-1]
                driven[:, number] += table @ equation.taps[inputs].ravel()
        # newest first
        state = rows.table[begin + depth - order : begin + depth, :size][::-1].ravel()
        with np.errstate(over="ignore", invalid="ignore"):
            for step, drive in enumerate(driven):
                value = past @ state + drive
                found[steps.start + step] = value
                state = np.concatenate((value, state[:-size]))
    return found


def relative_error(rows: FittedRows, predicted: FloatArray) -> float:
    """RMSE of held-out rows relative to that of the mean of the others, over all targets."""
    targets = rows.table[:, : rows.targets]
    mean = np.nanmean(targets[~rows.held_out], axis=0)
    used = rows.held_out[:, None] & np.isfinite(targets) & ~np.isnan(predicted)
    if not used.any():
        return np.inf
    with np.errstate(over="ignore", invalid="ignore"):
        squares = (np.where(used, predicted - targets, 0.0) ** 2).sum(axis=0)
    around = (np.where(used, targets - mean, 0.0) ** 2).sum(axis=0)
    ratio = float((squares / np.where(around > 0, around, 1.0)).mean())
    return float(np.sqrt(ratio)) if np.isfinite(ratio) else np.inf
