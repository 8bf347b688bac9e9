"""Calculates with constant vectors and 3 × 3 matrices: rotations, second moments of mass."""

from __future__ import annotations

import math

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_NOTHING = 1e-15
"""Smaller entries of a rotation are rounding errors of sines and cosines of π/2 and π."""


def vector(x: float, y: float, z: float) -> Vector:
    return (x, y, z)


def times(A: Matrix, v: Vector) -> Vector:
    """The product A v of a matrix and a vector."""
    x, y, z = (a[0] * v[0] + a[1] * v[1] + a[2] * v[2] for a in A)
    return x, y, z


def plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def scaled(factor: float, v: Vector) -> Vector:
    return factor * v[0], factor * v[1], factor * v[2]


def transposed(A: Matrix) -> Matrix:
    a, b, c = zip(*A, strict=True)
    return a, b, c


def product(A: Matrix, B: Matrix) -> Matrix:
    """The matrix product A B."""
    columns = transposed(B)
    return transposed((times(A, columns[0]), times(A, columns[1]), times(A, columns[2])))


def sum_of(A: Matrix, B: Matrix) -> Matrix:
    return plus(A[0], B[0]), plus(A[1], B[1]), plus(A[2], B[2])


def outer(a: Vector, b: Vector) -> Matrix:
    """The outer product a bᵀ, a matrix."""
    return scaled(a[0], b), scaled(a[1], b), scaled(a[2], b)


def multiple(factor: float, A: Matrix) -> Matrix:
    return scaled(factor, A[0]), scaled(factor, A[1]), scaled(factor, A[2])


def trace(A: Matrix) -> float:
    return A[0][0] + A[1][1] + A[2][2]


def rotation(roll: float, pitch: float, yaw: float) -> Matrix:
    """The rotation matrix Rz(yaw) Ry(pitch) Rx(roll) of the `rpy` angles of URDF, in rad."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(a), math.cos(a)) for a in (roll, pitch, yaw))
    return _clean(
        (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
    )


def to_axis(axis: Vector) -> Matrix:
    """A rotation that maps z to a unit vector; for ±x, ±y, ±z it contains only 0, 1 and −1.

    A vector slightly off an axis may also contain a rounded 1, so the other elements are compared
    with 0.
    """
    x, y, z = axis
    no_x, no_y, no_z = (_exact(number) == 0.0 for number in axis)
    if no_x and no_y:
        return ((1.0, 0.0, 0.0), (0.0, z, 0.0), (0.0, 0.0, z))
    if no_z and no_x:  # (x, y, z) → (z, x, y) where y is above 0
        return ((0.0, 1.0, 0.0), (0.0, 0.0, y), (y, 0.0, 0.0))
    if no_y and no_z:
        return ((0.0, 0.0, x), (x, 0.0, 0.0), (0.0, 1.0, 0.0))
    across = math.hypot(x, y)
    # perpendicular to the axis and to z; the axis is not z here, so `across` is above 0
    first = vector(y / across, -x / across, 0.0)
    # axis × first: the three are right-handed
    second = (-z * first[1], z * first[0], x * first[1] - y * first[0])
    # as columns: z goes to the axis
    return transposed((first, second, axis))


def second_moment(inertia: Matrix) -> Matrix:
    """The second moment Σ = ∫ r rᵀ dm of a body with the inertia matrix I = ∫ (rᵀr · 1 − r rᵀ) dm:
    Σ = tr(I)/2 · 1 − I.
    """
    return sum_of(multiple(trace(inertia) / 2, IDENTITY), multiple(-1.0, inertia))


def cholesky(A: Matrix) -> Matrix | None:
    """The lower triangular L of A = L Lᵀ; None if A is not positive definite."""
    L = [[0.0] * 3 for _ in range(3)]
    for j in range(3):
        rest = A[j][j] - sum(L[j][k] ** 2 for k in range(j))
        # written with a `not`, so that NaN is not positive either
        if not rest > 0.0:
            return None
        L[j][j] = math.sqrt(rest)
        for i in range(j + 1, 3):
            L[i][j] = (A[i][j] - sum(L[i][k] * L[j][k] for k in range(j))) / L[j][j]
    a, b, c = ((row[0], row[1], row[2]) for row in L)
    return a, b, c


def is_positive(A: Matrix) -> bool:
    """True if no eigenvalue of the symmetric matrix A is negative, except for rounding."""
    # relative to the entries: moments of files are rounded to a few digits
    shift = 1e-9 * sum(abs(number) for row in A for number in row)
    return shift == 0.0 or cholesky(sum_of(A, multiple(shift, IDENTITY))) is not None


def _clean(A: Matrix) -> Matrix:
    a, b, c = ((_exact(row[0]), _exact(row[1]), _exact(row[2])) for row in A)
    return a, b, c


def _exact(entry: float) -> float:
    near = round(entry)
    return float(near) if abs(entry - near) < _NOTHING else entry
