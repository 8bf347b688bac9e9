"""Represents a stable denominator by the normalised lattice with its poles.

The layers `iir` and `state_space` use the reflection coefficients of this lattice (Gray and Markel,
IEEE Trans. ASSP 23, 1975). For white input its signals are orthonormal, however close the poles are
to each other and to the unit circle. Powers of 1/z divided by the denominator are nearly dependent
there, already for a handful of poles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msnn.data.dataset import FloatArray

ComplexArray = NDArray[np.complex128]

MARGIN = 1e-6
"""Relative distance of poles from the stability limit."""
LARGEST = 1 - 1e-7
"""Maximum reflection coefficient, which stays below 1 in single precision too."""


@dataclass(frozen=True, slots=True)
class Lattice:
    """The all-pass with reflection coefficients r: bᵢ has the numerator of degree i in 1/z.

    From the last section to the first, f = √(1−rᵢ²) f − rᵢ xᵢ and bᵢ₊₁ = rᵢ f + √(1−rᵢ²) xᵢ. The
    first f is the input, xᵢ[t] = bᵢ[t−1], and b₀ is the last f. Every two columns of the matrix [A
    b; c d] are orthonormal.
    """

    reflection: FloatArray
    matrix: FloatArray
    """A: maps x to the next x, b₀ … bₙ₋₁."""
    drive: FloatArray
    """b: maps the input to the next x."""
    last: FloatArray
    """[c d]: maps x and the input to bₙ."""


def lattice_of(reflection: FloatArray) -> Lattice:
    """The lattice filter with these reflection coefficients, (order,), as matrices of a state-space
    model.
    """
    order = len(reflection)
    signals = np.eye(order + 1)
    forward = signals[order]
    rows: list[FloatArray] = []
    for i in reversed(range(order)):
        r, cosine = reflection[i], np.sqrt(1 - reflection[i] ** 2)
        rows.append(r * forward + cosine * signals[i])
        forward = cosine * forward - r * signals[i]
    # rows came from bₙ down to b₁; what is left of f is b₀
    step = np.array([forward, *reversed(rows)])
    return Lattice(reflection, step[:order, :order], step[:order, order], step[order])


def backward_polynomials(reflection: FloatArray) -> FloatArray:
    """The numerators of b₀ … bₙ over A, one row each, from z⁰; A is the last, reversed.

    Levinson's recursion; the factor of bᵢ is the product of √(1−rₖ²) for k ≥ i.
    """
    order = len(reflection)
    found = np.zeros((order + 1, order + 1))
    polynomial = np.ones(1)
    found[0, 0] = 1.0
    for i, r in enumerate(reflection):
        longer = np.concatenate((polynomial, [0.0]))
        polynomial = longer + r * longer[::-1]
        found[i + 1, : i + 2] = polynomial[::-1]
    cosines = np.sqrt(1 - reflection**2)
    return found * np.concatenate((np.cumprod(cosines[::-1])[::-1], [1.0]))[:, None]


def denominator_of(reflection: FloatArray) -> FloatArray:
    """The coefficients of A in 1/z, (order + 1,), which begin with 1."""
    return backward_polynomials(reflection)[-1, ::-1]


def reflections_of(poles: ComplexArray) -> FloatArray:
    """The reflection coefficients of the real denominator with these poles, all inside the circle.

    A cascade of one all-pass per pole has an orthogonal step matrix. Householder reflections bring
    it to the unique form in which only the last state reaches the output and A is a Hessenberg
    matrix, which is the lattice. This avoids polynomial coefficients, which lose accuracy with many
    close poles.
    """
    matrix, output = _cascade(poles)
    matrix, output = _hessenberg(matrix, output)
    forward, found = matrix[0], np.zeros(len(poles))
    # takes off the sections from b₀ on: the column of xᵢ has −r of one in f, √(1−r²) in bᵢ₊₁
    for i in range(len(poles)):
        side = output[i] if i + 1 == len(poles) else matrix[i + 1, i]
        size = np.hypot(forward[i], side)
        found[i] = -forward[i] / size
        if i + 1 < len(poles):
            forward = side / size * forward + found[i] * matrix[i + 1]
    return np.clip(found, -LARGEST, LARGEST)


def stable(poles: ComplexArray, radius: float) -> ComplexArray:
    """The poles reflected into the unit circle and limited to the radius."""
    limit = radius * (1 - MARGIN)
    sizes = np.abs(poles)
    # λ → 1/λ̄ changes the magnitude of the response by a constant factor only
    inside = np.where(sizes > 1, poles / np.maximum(sizes, 1) ** 2, poles)
    sizes = np.abs(inside)
    return np.where(sizes > limit, inside * limit / np.maximum(sizes, limit), inside)


def reflections_that_round(poles: ComplexArray, radius: float) -> FloatArray:
    """The reflection coefficients of poles moved inward until the rounded coefficients of A are
    stable.

    Filters that compute with A need this: with six poles at 0.9999, rounding makes some unstable.
    """
    found = reflections_of(poles)
    while (largest := np.max(np.abs(np.roots(denominator_of(found))), initial=0.0)) >= radius:
        # all by one factor: their angles, the frequencies, stay
        poles = poles * (radius * (1 - MARGIN) / largest)
        found = reflections_of(poles)
    return found


def _cascade(poles: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """A and c of a cascade of all-passes: x⁺ = λ x + s v, and the next v is s x − λ̄ v."""
    order = len(poles)
    matrix, value = np.zeros((order, order), complex), np.zeros(order, complex)
    for k, pole in enumerate(poles):
        # not 1 − |λ|², which loses its digits beside the unit circle
        s = np.sqrt((1 - abs(pole)) * (1 + abs(pole)))
        matrix[k] = s * value
        matrix[k, k] = pole
        value = -np.conj(pole) * value
        value[k] = s
    return matrix, value


def _hessenberg(matrix: ComplexArray, output: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """The same system in Hessenberg form: c has only its last element, A none below its
    subdiagonal.

    Phases make both positive, and the rest real, because the poles are those of a real system.
    """
    order = len(output)
    turned, first = matrix.conj().T.copy(), output.conj().copy()
    for k in range(order):
        column = first if k == 0 else turned[:, k - 1]
        mirror = column[k:].copy()
        size = np.linalg.norm(mirror)
        # already 0: there is nothing to reflect
        if size == 0.0:
            continue
        # away from the axis, so that nothing cancels (Golub, Van Loan, Matrix Computations, §5.1)
        mirror[0] += size * (mirror[0] / abs(mirror[0]) if mirror[0] else 1.0)
        mirror /= np.linalg.norm(mirror)
        turned[k:] -= 2 * np.outer(mirror, mirror.conj() @ turned[k:])
        turned[:, k:] -= 2 * np.outer(turned[:, k:] @ mirror, mirror.conj())
        if k == 0:
            first = first - 2 * np.vdot(mirror, first) * mirror
    # back from the adjoint, with the states in opposite order
    upper = turned.conj().T[::-1, ::-1]
    last = first.conj()[::-1]
    phases = np.ones(order, complex)
    for i in reversed(range(order)):
        below = last[i] if i + 1 == order else phases[i + 1] * upper[i + 1, i]
        phases[i] = below / abs(below) if below else 1.0
    upper = phases[:, None] * upper * phases.conj()
    return np.real(upper), np.real(last * phases.conj())
