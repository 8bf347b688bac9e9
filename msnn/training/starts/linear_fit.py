"""Fits the stable linear filter from one signal to another by least squares.

First least squares of the equation error (Ljung, System Identification, 2nd ed. 1999, §4.2), then
iterations of Steiglitz and McBride (IEEE Trans. Automatic Control 10, 1965), which approximate the
output error. Gauss-Newton steps finally minimise the output error.

The equations B/A u = y are linear in the signals of a lattice with given poles.
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
from msnn.training.starts.lattice import (
    Lattice,
    backward_polynomials,
    denominator_of,
    lattice_of,
    reflections_of,
    reflections_that_round,
    stable,
)
from msnn.training.starts.linear_system import ROWS_AT_ONCE, LinearSystem, Triangle, least_squares

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
    """The solution of the least-squares equations: gains of the input, and of each segment's
    unknown past.
    """

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
        """The columns b(u) after QR: (rows, taps)."""
        return self.triangle[:, : self.structure.taps]

    @property
    def output(self) -> FloatArray:
        """The column y after QR: (rows,)."""
        return self.triangle[:, self.structure.taps]

    @property
    def behind(self) -> FloatArray:
        """The columns x after QR: (rows, poles)."""
        return self.triangle[:, self.structure.taps + 1 :]

    def response(self) -> Response:
        """The least-squares solution for the gains g, without c, and for the unknown past of each
        segment.
        """
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


MOST_ITERATIONS = 40
MOST_STEPS = 20
"""Maximum number of Gauss-Newton steps."""
_PATIENCE = 3
"""Iterations without improvement before stopping: Steiglitz-McBride does not always descend."""
_WORTH = 1e-3
_LEAST = 1e-5
"""Minimum relative decrease of the error by an iteration (`_WORTH`) and by a step (`_LEAST`)."""
_SHARES = (1.0, 0.5, 0.25, 0.0625)
"""Step lengths to try."""
_ENOUGH = 1 << 17
"""Maximum rows for the iterations; Gauss-Newton steps use all rows."""
_PART = 1 << 13


@dataclass(frozen=True, slots=True)
class Filter:
    """B(z⁻¹)/A(z⁻¹): B from z⁰, A by its reflection coefficients."""

    numerator: FloatArray
    reflection: FloatArray

    @property
    def denominator(self) -> FloatArray:
        """The coefficients of A in 1/z, which begin with 1."""
        return denominator_of(self.reflection)


def fitted_filter(pieces: Sequence[UnbrokenRows], structure: FilterStructure) -> Filter | None:
    """The filter that minimises the output error over the segments; None if there are too
    few rows.
    """
    # the unknown past of a piece takes `depth` of its rows, so that they are no equations
    long = [piece for piece in pieces if len(piece.input) > structure.depth]
    rows = sum(len(piece.input) - structure.depth for piece in long)
    if rows < structure.den + structure.taps:
        return None
    # both of size 1: their gains can be compared, whatever the units; the numerator takes it back
    gain = size_of([piece.output for piece in long]), size_of([piece.input for piece in long])
    scaled = [UnbrokenRows(piece.input / gain[1], piece.output / gain[0]) for piece in long]
    begun = _iterated(_spread(scaled, structure), structure)
    found = _descended(scaled, structure, begun)
    # gains of the orthonormal b₀ … become coefficients of powers of 1/z; taps before `first` are 0
    taps = (
        found.response.gains
        @ backward_polynomials(structure.padded(found.reflection))[: structure.taps]
    )
    numerator = np.concatenate((np.zeros(structure.first), taps))[: structure.num + 1]
    return Filter(numerator * (gain[0] / gain[1]), found.reflection)


def size_of(parts: Sequence[FloatArray]) -> float:
    """The RMS of all elements; 1 if they are all 0."""
    squares = sum(float(np.vdot(part, part)) for part in parts)
    return float(np.sqrt(squares / sum(part.size for part in parts))) or 1.0


@dataclass(frozen=True, slots=True)
class _Fit:
    """The best B for a given A, and the update direction of A."""

    reflection: FloatArray
    response: Response
    error: float
    turn: FloatArray
    """c: the new A divided by the old one is 1 + c (zI − A)⁻¹ b."""


def _spread(pieces: Sequence[UnbrokenRows], structure: FilterStructure) -> list[UnbrokenRows]:
    """Evenly spaced segments of long recordings, sufficient for an initial point."""
    long = max(_PART, 100 * structure.depth)
    parts = [
        UnbrokenRows(piece.input[begin : begin + long], piece.output[begin : begin + long])
        for piece in pieces
        for begin in range(0, len(piece.input), long)
    ]
    rows = sum(len(part.input) for part in parts)
    # as many parts as have _ENOUGH rows together
    count = len(parts) * _ENOUGH // rows
    if count >= len(parts):
        return list(pieces)
    chosen = np.unique(np.linspace(0, len(parts) - 1, max(count, 1)).round().astype(int))
    return [part for i in chosen if len((part := parts[i]).input) > structure.depth]


def _iterated(pieces: Sequence[UnbrokenRows], structure: FilterStructure) -> FloatArray:
    """The poles with the minimum error among Steiglitz-McBride iterations, which begin at 0."""
    now = _fit(pieces, structure, np.zeros(structure.den))
    best, waited = now, 0
    for _ in range(MOST_ITERATIONS):
        now = _fit(pieces, structure, _turned(structure, now.reflection, now.turn))
        waited = 0 if now.error < best.error * (1 - _WORTH) else waited + 1
        best = now if now.error < best.error else best
        if waited == _PATIENCE:
            break
    return best.reflection


def _descended(
    pieces: Sequence[UnbrokenRows], structure: FilterStructure, first: FloatArray
) -> _Fit:
    """Gauss-Newton steps of the output error from the poles `first`, as long as the error
    decreases.

    The equations with x driven by g b(u), instead of y, have the Jacobian of the output error.
    """
    best = _fit(pieces, structure, first)
    for _ in range(MOST_STEPS):
        turn = _fit(pieces, structure, best.reflection, best.response).turn
        before = best.error
        for share in _SHARES:
            tried = _fit(pieces, structure, _turned(structure, best.reflection, share * turn))
            if tried.error < best.error:
                best = tried
                break
        if best.error >= before * (1 - _LEAST):
            break
    return best


def _fit(
    pieces: Sequence[UnbrokenRows],
    structure: FilterStructure,
    reflection: FloatArray,
    driving: Response | None = None,
) -> _Fit:
    """The least-squares solution at these poles, its error, and the direction to better poles."""
    equations = equations_of(pieces, structure, reflection, driving)
    # y + c x = g b(u), solved for y: the unknowns are g, then c
    both = np.concatenate((equations.signals, -equations.behind), axis=1)
    turn = least_squares(both, equations.output)[structure.taps :]
    response = equations.response()
    error = float(np.linalg.norm(equations.output - equations.signals @ response.gains))
    return _Fit(reflection, response, error, turn)


def _turned(structure: FilterStructure, reflection: FloatArray, turn: FloatArray) -> FloatArray:
    """The reflection coefficients of A after an update: its roots are the zeros of 1 + c (zI − A)⁻¹
    b.

    `turn` is c. The roots are moved inside the circle `structure.radius`.
    """
    lattice = lattice_of(reflection)
    # det(zI − A + b c) = det(zI − A) (1 + c (zI − A)⁻¹ b): the zeros are eigenvalues of A − b c
    zeros = np.linalg.eigvals(lattice.matrix - np.outer(lattice.drive, turn))
    poles = stable(np.asarray(zeros, complex), structure.radius)
    if structure.is_direct:
        return reflections_that_round(poles, structure.radius)
    return reflections_of(poles)
