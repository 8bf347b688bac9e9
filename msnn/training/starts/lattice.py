"""Represents a stable denominator by the normalised lattice with its poles.

The lattice (Gray and Markel, IEEE Trans. ASSP 23, 1975) is what the layers `iir` and `state_space`
have their reflection coefficients of. Its signals are orthonormal where the input is white, however
close the poles are to each other and to the unit circle; powers of 1/z divided by the denominator
are as good as dependent there, from a handful of poles on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msnn.data.dataset import FloatArray

ComplexArray = NDArray[np.complex128]

MARGIN = 1e-6
"""What keeps poles off the limit, where a filter is no longer stable."""
LARGEST = 1 - 1e-7
"""Of a reflection coefficient: it stays off its bound in single precision too."""


@dataclass(frozen=True, slots=True)
class Lattice:
    """The all-pass with reflection coefficients r: bᵢ has the numerator of degree i in 1/z.

    f = √(1−rᵢ²) f − rᵢ xᵢ and bᵢ₊₁ = rᵢ f + √(1−rᵢ²) xᵢ from the last section to the first, f the
    input at first, xᵢ[t] = bᵢ[t−1], b₀ = f at last. Of the matrix [A b; c d] every two columns are
    orthogonal and of length 1.
    """

    reflection: FloatArray
    matrix: FloatArray
    """A: x after the step, b₀ … bₙ₋₁, of x."""
    drive: FloatArray
    """b: the same of the input."""
    last: FloatArray
    """[c d]: bₙ of x, and of the input."""


def lattice_of(reflection: FloatArray) -> Lattice:
    """The lattice with these coefficients."""
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
    """The numerators of b₀ … bₙ over A, a row each, from z⁰; A = the last, backwards.

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
    """A from z⁰, which begins with 1."""
    return backward_polynomials(reflection)[-1, ::-1]


def reflections_of(poles: ComplexArray) -> FloatArray:
    """The reflection coefficients of the real denominator with these poles, all inside the circle.

    A cascade of one all-pass for each pole has an orthogonal step. Reflections of Householder bring
    it to the one form in which only the last state reaches the output and A is a Hessenberg matrix,
    which is the lattice: no coefficients of polynomials, which many poles in one place round away.
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
    """The poles reflected into the unit circle and drawn into the radius."""
    limit = radius * (1 - MARGIN)
    sizes = np.abs(poles)
    # λ → 1/λ̄ changes the magnitude of the response by a constant factor only
    inside = np.where(sizes > 1, poles / np.maximum(sizes, 1) ** 2, poles)
    sizes = np.abs(inside)
    return np.where(sizes > limit, inside * limit / np.maximum(sizes, limit), inside)


def reflections_that_round(poles: ComplexArray, radius: float) -> FloatArray:
    """The same of poles so far inside that the coefficients of A, rounded, are stable as well.

    A filter that computes with them needs it: of six poles at 0.9999 rounding moves some outside.
    """
    found = reflections_of(poles)
    while (largest := np.max(np.abs(np.roots(denominator_of(found))), initial=0.0)) >= radius:
        # all by one factor: their angles, the frequencies, stay
        poles = poles * (radius * (1 - MARGIN) / largest)
        found = reflections_of(poles)
    return found


def _cascade(poles: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """A and c of all-passes in a row: x⁺ = λ x + s v, then s x − λ̄ v is the next v."""
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
    """The same system, turned: c has its last element alone, A nothing below its subdiagonal.

    Phases make both positive, and all the rest real, for the poles are those of a real system.
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
