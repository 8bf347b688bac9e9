"""Fits the stable linear filter from one signal to another, in least squares.

Least squares of the equation error (Ljung, System Identification, 2nd ed. 1999, §4.2), then the
iterations of Steiglitz and McBride (IEEE Trans. Automatic Control 10, 1965), which weigh it towards
the error of the output.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray

ITERATIONS = 10
_BLOCK = 128
"""Rows that a filter computes at once."""
MARGIN = 1e-6
"""What keeps poles off the limit, where a filter is no longer stable."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Input and output at rows without gap."""

    input: FloatArray
    output: FloatArray


@dataclass(frozen=True, slots=True)
class Structure:
    """Which filters there are: taps `first` … `num`, `den` poles within `radius`."""

    first: int
    num: int
    den: int
    radius: float

    @property
    def depth(self) -> int:
        """How many rows the unknown past of a piece reaches into."""
        return max(self.num, self.den)

    @property
    def taps(self) -> int:
        return self.num + 1 - self.first


@dataclass(frozen=True, slots=True)
class Filter:
    """B(z⁻¹)/A(z⁻¹), both from z⁰; A begins with 1."""

    numerator: FloatArray
    denominator: FloatArray


def fitted_filter(pieces: Sequence[Piece], structure: Structure) -> Filter | None:
    """The filter with the least error of the output; None where the data do not determine one."""
    long = [piece for piece in pieces if len(piece.input) > structure.depth]
    rows = sum(len(piece.input) - structure.depth for piece in long)
    if rows < structure.den + structure.taps:
        return None
    poles = np.concatenate(([1.0], np.zeros(structure.den)))
    best, least = Filter(np.zeros(structure.num + 1), poles), np.inf
    for _ in range(ITERATIONS + 1):
        poles = _stable(_denominator(long, structure, poles), structure.radius)
        numerator, error = _numerator(long, structure, poles)
        if error < least:
            best, least = Filter(numerator, poles), error
    return best


def power_series(denominator: FloatArray, count: int) -> FloatArray:
    """The first elements of 1/A."""
    return filtered(np.concatenate(([1.0], np.zeros(count - 1))), denominator)


def filtered(signal: FloatArray, denominator: FloatArray) -> FloatArray:
    """The signal through 1/A: x[n] = u[n] − Σ aⱼ x[n−j], as many rows at once as a block has.

    Within a block x = S (u − past), where S has the first elements of 1/A below its diagonal. The
    recursion forgets roundings as the filter forgets its input; a division of power series by
    transforms lets them grow with the length.
    """
    order, rows = len(denominator) - 1, min(_BLOCK, len(signal))
    response = np.zeros(rows)
    for n in range(rows):
        reached = min(order, n)
        last = response[n - reached : n][::-1]
        response[n] = (n == 0) - denominator[1 : reached + 1] @ last
    distance = np.subtract.outer(np.arange(rows), np.arange(rows))
    solution = np.where(distance >= 0, response[np.maximum(distance, 0)], 0.0)
    # the share of x[n−j], which lies j − row places before the block, in each row of the block
    reach = min(order, rows)
    past = np.zeros((rows, order))
    for row in range(reach):
        past[row, row:] = denominator[row + 1 :][::-1][: order - row]
    found = np.zeros(order + len(signal))
    for begin in range(0, len(signal), rows):
        block = signal[begin : begin + rows]
        size = len(block)
        free = block - past[:size] @ found[begin : begin + order]
        found[order + begin : order + begin + size] = solution[:size, :size] @ free
    return found[order:]


def convolved(first: FloatArray, second: FloatArray, count: int) -> FloatArray:
    """The first elements of the product of two series."""
    return np.convolve(first, second)[:count]


def _denominator(pieces: Sequence[Piece], structure: Structure, poles: FloatArray) -> FloatArray:
    """A of A y = B u, with both sides filtered by 1/A of the iteration before."""
    rows: list[FloatArray] = []
    for piece in pieces:
        output = filtered(piece.output, poles)
        columns = [-_later(output, delay) for delay in range(1, structure.den + 1)]
        rows.append(_reduced(piece, structure, poles, columns, output))
    found, _ = _solved(rows)
    return np.concatenate(([1.0], found[structure.taps :]))


def _numerator(
    pieces: Sequence[Piece], structure: Structure, poles: FloatArray
) -> tuple[FloatArray, float]:
    """B of y = B/A u, and the error that is left."""
    rows = [_reduced(piece, structure, poles, [], piece.output) for piece in pieces]
    found, error = _solved(rows)
    return np.concatenate((np.zeros(structure.first), found)), error


def _reduced(
    piece: Piece,
    structure: Structure,
    poles: FloatArray,
    columns: Sequence[FloatArray],
    wanted: FloatArray,
) -> FloatArray:
    """The equations of a piece as a triangle, without what its unknown past explains.

    The past acts through the first rows only, as impulses filtered by 1/A: any multiple of them
    is free. An orthogonal transformation leaves the sum of squares as it is.
    """
    signal, series = filtered(piece.input, poles), power_series(poles, len(piece.input))
    past = [_later(series, delay) for delay in range(structure.depth)]
    taps = [_later(signal, delay) for delay in range(structure.first, structure.num + 1)]
    table = np.stack([*past, *taps, *columns, wanted], axis=1)
    triangle = np.asarray(np.linalg.qr(table, mode="r"), dtype=np.float64)
    return triangle[structure.depth :, structure.depth :]


def _solved(rows: Sequence[FloatArray]) -> tuple[FloatArray, float]:
    """Least squares, and the length of the error; of many solutions the smallest."""
    table = np.concatenate(rows)
    left, right = table[:, :-1], table[:, -1]
    found = np.asarray(np.linalg.lstsq(left, right, rcond=None)[0], dtype=np.float64)
    return found, float(np.linalg.norm(right - left @ found))


def _later(series: FloatArray, delay: int) -> FloatArray:
    return np.concatenate((np.zeros(delay), series[: len(series) - delay]))


def _stable(denominator: FloatArray, radius: float) -> FloatArray:
    """The poles reflected into the unit circle and drawn into the radius."""
    poles = np.roots(denominator)
    limit = radius * (1 - MARGIN)
    if np.all(np.abs(poles) <= limit):
        return denominator  # untouched, for roots of equal value are found roughly
    sizes = np.abs(poles)
    inside = np.where(sizes > 1, poles / np.maximum(sizes, 1) ** 2, poles)
    sizes = np.abs(inside)
    inside = np.where(sizes > limit, inside * limit / np.maximum(sizes, limit), inside)
    found = np.asarray(np.real(np.poly(inside)), dtype=np.float64)
    # many poles in one place are those of rounded coefficients: some can lie outside again
    while (largest := float(np.max(np.abs(np.roots(found)), initial=0.0))) >= radius:
        found *= (limit / largest) ** np.arange(len(found))
    return np.concatenate((found, np.zeros(len(denominator) - len(found))))
