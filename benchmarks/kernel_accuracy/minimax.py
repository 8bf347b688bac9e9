"""Fits polynomials by Remez' exchange in high precision and rounds them to a binary format."""

from __future__ import annotations

from collections.abc import Callable

from mpmath import mp, mpf

Function = Callable[[mpf], mpf]

GRID = 600


def round_to(value: mpf, digits: int) -> mpf:
    """The nearest number with `digits` bits of significand."""
    if value == 0:
        return mpf(0)
    exponent = int(mp.floor(mp.log(abs(value), 2)))
    unit = mpf(2) ** (exponent - digits + 1)
    return mp.nint(value / unit) * unit


def fit(
    target: Function, weight: Function, low: float, high: float, degree: int, digits: int
) -> tuple[list[mpf], mpf]:
    """Coefficients c₀ … c_degree, representable, of the polynomial near `target`; its error.

    Minimises max |weight·(target − Σ cᵢ xⁱ)|. One coefficient after the other is rounded, from the
    lowest, and the remaining ones are fitted again to what is left.
    """
    grid = [
        (mpf(low) + mpf(high)) / 2
        - (mpf(high) - mpf(low)) / 2 * mp.cos(mp.pi * (i + mpf(1) / 2) / GRID)
        for i in range(GRID)
    ]
    goals = [target(x) for x in grid]
    weights = [weight(x) for x in grid]
    fixed: list[mpf] = []
    for first in range(degree + 1):
        left = [
            goal - sum((c * x**i for i, c in enumerate(fixed)), mpf(0))
            for goal, x in zip(goals, grid, strict=True)
        ]
        rest = _remez(grid, left, weights, first, degree)
        fixed.append(round_to(rest[0], digits))
    error = max(
        abs(w * (goal - sum(c * x**i for i, c in enumerate(fixed))))
        for goal, x, w in zip(goals, grid, weights, strict=True)
    )
    return fixed, error


def _remez(
    grid: list[mpf], goals: list[mpf], weights: list[mpf], first: int, degree: int
) -> list[mpf]:
    count = degree - first + 1
    points = [int((i + 0.5) * GRID / (count + 1)) for i in range(count + 1)]
    best: list[mpf] = []
    best_error = mp.inf
    # without their lowest powers the monomials are no Haar system where the interval holds 0, so
    # that the exchange may wander: the best of its steps is taken
    for _ in range(30):
        matrix = mp.matrix(count + 1, count + 1)
        right = mp.matrix(count + 1, 1)
        for row, point in enumerate(points):
            for column in range(count):
                matrix[row, column] = grid[point] ** (first + column)
            matrix[row, count] = (-1) ** row / weights[point]
            right[row] = goals[point]
        solution = mp.lu_solve(matrix, right)
        coefficients = [solution[i] for i in range(count)]
        errors = [
            w * (goal - sum(c * x ** (first + i) for i, c in enumerate(coefficients)))
            for goal, x, w in zip(goals, grid, weights, strict=True)
        ]
        if max(map(abs, errors)) < best_error:
            best, best_error = coefficients, max(map(abs, errors))
        exchanged = _alternating_extremes(errors, count + 1)
        if exchanged is None or exchanged == points:
            break
        points = exchanged
    return best


def _alternating_extremes(errors: list[mpf], count: int) -> list[int] | None:
    """Indices of the largest error in each interval of equal sign, for `count` neighbouring
    intervals.

    None if there are fewer.
    """
    extremes: list[int] = []
    for i, error in enumerate(errors):
        if extremes and (errors[extremes[-1]] > 0) == (error > 0):
            if abs(error) > abs(errors[extremes[-1]]):
                extremes[-1] = i
        else:
            extremes.append(i)
    if len(extremes) < count:
        return None
    while len(extremes) > count:
        at_front = abs(errors[extremes[0]]) < abs(errors[extremes[-1]])
        extremes.pop(0 if at_front else -1)
    return extremes
