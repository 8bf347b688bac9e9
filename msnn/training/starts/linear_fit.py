"""The stable linear filter from one signal to another that is nearest in least squares.

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
    """The first elements of 1/A, by Newton's iteration: each doubles how many are right."""
    found = np.ones(1)
    while len(found) < count:
        size = min(2 * len(found), count)
        product = convolved(denominator[:size], found, size)
        found = convolved(found, 2 * (np.arange(size) == 0) - product, size)
    return found


def convolved(first: FloatArray, second: FloatArray, count: int) -> FloatArray:
    """The first elements of the product of two series, zeros after the last of each."""
    size = len(first) + len(second) + count
    product = np.fft.rfft(first, size) * np.fft.rfft(second, size)
    return np.fft.irfft(product, size)[:count]


def _denominator(pieces: Sequence[Piece], structure: Structure, poles: FloatArray) -> FloatArray:
    """A of A y = B u, with both sides filtered by 1/A of the iteration before."""
    rows: list[FloatArray] = []
    for piece in pieces:
        series = power_series(poles, len(piece.input))
        output = convolved(series, piece.output, len(series))
        columns = [-_later(output, delay) for delay in range(1, structure.den + 1)]
        rows.append(_reduced(piece, structure, series, columns, output))
    found, _ = _solved(rows)
    return np.concatenate(([1.0], found[structure.taps :]))


def _numerator(
    pieces: Sequence[Piece], structure: Structure, poles: FloatArray
) -> tuple[FloatArray, float]:
    """B of y = B/A u, and the error that is left."""
    rows = [
        _reduced(piece, structure, power_series(poles, len(piece.input)), [], piece.output)
        for piece in pieces
    ]
    found, error = _solved(rows)
    return np.concatenate((np.zeros(structure.first), found)), error


def _reduced(
    piece: Piece,
    structure: Structure,
    series: FloatArray,
    columns: Sequence[FloatArray],
    wanted: FloatArray,
) -> FloatArray:
    """The equations of a piece as a triangle, without what its unknown past explains.

    The past acts through the first rows only, as impulses filtered by 1/A: any multiple of them
    is free. An orthogonal transformation leaves the sum of squares as it is.
    """
    signal = convolved(series, piece.input, len(series))
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
    return np.concatenate((found, np.zeros(len(denominator) - len(found))))
