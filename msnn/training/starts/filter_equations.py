"""Writes B/A u = y as linear equations in the signals of a lattice with given poles.

A divided by the denominator of these poles is 1 + c (zI − A)⁻¹ b for some row c. B divided by it
is g b(u), and x and b(u) are signals of the lattice. Hence y + c x = g b(u). Powers of 1/z
over the denominator span the same space, but are nearly dependent for a handful of close poles. Van
den Hof, Heuberger and Bokor (Automatica 31, 1995) use such bases for the same reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.training.starts.lattice import Lattice, lattice_of
from msnn.training.starts.linear_system import LinearSystem
from msnn.training.starts.tall_least_squares import ROWS_AT_ONCE, Triangle, least_squares

FORGOTTEN = 1e-18
"""Remaining influence of the past that is numerically zero."""


@dataclass(frozen=True, slots=True)
class UnbrokenRows:
    """Input and output at consecutive rows without a gap."""

    input: FloatArray
    output: FloatArray


@dataclass(frozen=True, slots=True)
class FilterStructure:
    """A class of filters: taps `first` … `num`, `den` poles within `radius`."""

    first: int
    num: int
    den: int
    radius: float
    is_direct: bool = False
    """True if the layer computes with coefficients of A and B, which are rounded."""

    @property
    def depth(self) -> int:
        """Number of rows that the unknown past of a segment affects."""
        return max(self.num, self.den)

    @property
    def taps(self) -> int:
        return self.num + 1 - self.first

    def padded(self, reflection: FloatArray) -> FloatArray:
        """The coefficients with poles at 0 if the numerator has the higher order."""
        return np.concatenate((reflection, np.zeros(self.depth - self.den)))


@dataclass(frozen=True, slots=True)
class Response:
    """The response of a filter to the input and to the unknown samples before each segment."""

    gains: FloatArray
    """Coefficients of b₀ … of the input."""
    pasts: tuple[FloatArray, ...]
    """Coefficients of the free responses of the lattice, one row per segment."""


@dataclass(frozen=True, slots=True)
class FilterEquations:
    """The least-squares equations y + c x = g b(u) of a filter B/A, for unknown g and c.

    y is the output; the signals b(u) and x are those of lattices driven by the input u and by y.
    Unknown samples before a segment of data add free responses of the lattice, which decay. Their
    coefficients are eliminated by orthogonal transformations, which preserve sums of squares.
    """

    structure: FilterStructure
    triangle: FloatArray
    """The triangular factor (QR) of the columns b(u), y and x."""
    heads: tuple[FloatArray, ...]
    """The eliminated rows of each segment, with the columns of its unknown past first."""

    @property
    def signals(self) -> FloatArray:
        """The columns b(u)."""
        return self.triangle[:, : self.structure.taps]

    @property
    def output(self) -> FloatArray:
        """The column y."""
        return self.triangle[:, self.structure.taps]

    @property
    def behind(self) -> FloatArray:
        """The columns x."""
        return self.triangle[:, self.structure.taps + 1 :]

    def response(self) -> Response:
        """The least-squares coefficients."""
        gains = least_squares(self.signals, self.output)
        depth, end = self.structure.depth, self.structure.depth + self.structure.taps
        # what the past explains is fitted to what the input leaves of it
        pasts = [
            least_squares(head[:, :depth], head[:, end] - head[:, depth:end] @ gains)
            for head in self.heads
        ]
        return Response(gains, tuple(pasts))


def equations_of(
    pieces: Sequence[UnbrokenRows],
    structure: FilterStructure,
    reflection: FloatArray,
    response: Response | None = None,
) -> FilterEquations:
    """The equations at these poles; x is driven by y, or by `response` if given."""
    # taps need a lattice of the numerator's order, x one of the denominator's
    seen = lattice_of(structure.padded(reflection))
    systems = _system(seen), _system(lattice_of(reflection))
    columns = structure.taps + 1 + structure.den
    triangle = Triangle(columns)
    heads: list[FloatArray] = []
    for number, piece in enumerate(pieces):
        head = Triangle(structure.depth + columns)
        driven = None if response is None else (response.gains, response.pasts[number])
        for free, table in _tables(piece, structure, seen, systems, driven):
            if free is None:
                triangle.add(table)
            else:
                # the free responses stand first: the triangle's first rows are what they explain,
                # the rest is left
                head.add(np.concatenate((free, table), axis=1))
        heads.append(head.above(structure.depth))
        triangle.add(head.below(structure.depth))
    return FilterEquations(structure, triangle.below(0), tuple(heads))


def _system(lattice: Lattice) -> LinearSystem:
    return LinearSystem(lattice.matrix, lattice.drive[:, None])


def _tables(
    piece: UnbrokenRows,
    structure: FilterStructure,
    lattice: Lattice,
    systems: tuple[LinearSystem, LinearSystem],
    driven: tuple[FloatArray, FloatArray] | None,
) -> Iterator[tuple[FloatArray | None, FloatArray]]:
    """Yields blocks of rows: free responses of the past (None once they have decayed), and the
    rest.
    """
    # the unknown past is not in the states: it adds free responses
    seen, behind = np.zeros(structure.depth), np.zeros(structure.den)
    # the elements of Aᵗb span all free responses, as the lattice is controllable
    past = lattice.drive
    for begin in range(0, len(piece.input), ROWS_AT_ONCE):
        signal = piece.input[begin : begin + ROWS_AT_ONCE]
        output = piece.output[begin : begin + ROWS_AT_ONCE]
        x = systems[0].states(signal[:, None], seen)
        if structure.first:
            # xᵢ is bᵢ of the row before
            taps = x[:-1, : structure.taps]
        else:
            # b₀ … bₙ₋₁ are the states of the next row; bₙ is made of x and the input
            last = x[:-1] @ lattice.last[:-1] + signal * lattice.last[-1]
            taps = np.concatenate((x[1:], last[:, None]), axis=1)[:, : structure.taps]
        free: FloatArray | None = None
        if begin == 0 or np.max(np.abs(past)) > FORGOTTEN:
            responses = systems[0].states(np.zeros((len(signal), 1)), past)
            free, past = responses[:-1], responses[-1]
        driving = output
        if driven is not None:
            driving = taps @ driven[0] + (0.0 if free is None else free @ driven[1])
        y = systems[1].states(driving[:, None], behind)
        seen, behind = x[-1], y[-1]
        yield free, np.concatenate((taps, output[:, None], y[:-1]), axis=1)
