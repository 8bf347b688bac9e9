"""Defines the mass of a robot's body with its first and second moments."""

from __future__ import annotations

from dataclasses import dataclass

from msnn.features.robots.dynamics.numbers import (
    NOTHING,
    Number,
    Rows,
    Triple,
    congruent,
    dot,
    plus,
    scaled,
    sum_of,
    symmetric,
    times,
)

_NO_MOMENTS: Rows = (NOTHING, NOTHING, NOTHING)


@dataclass(frozen=True, slots=True)
class MassDistribution:
    """m, h = ∫ r dm and Σ = ∫ r rᵀ dm about the origin of a frame: the pseudo-inertia.

    The distributions of bodies can be added. They are linear in a body's ten inertial parameters
    (Wensing, Kim, Slotine: Linear Matrix Inequalities for Physically Consistent Inertial Parameter
    Identification, 2018, equation 10).
    """

    mass: Number = 0.0
    first: Triple = NOTHING
    second: Rows = _NO_MOMENTS

    def __add__(self, other: MassDistribution) -> MassDistribution:
        return MassDistribution(
            self.mass + other.mass,
            plus(self.first, other.first),
            sum_of(self.second, other.second),
        )

    def in_parent(self, R: Rows, r: Triple) -> MassDistribution:
        """The same distribution in a parent frame, in which x is R x + r.

        Σ' = R Σ Rᵀ + h' rᵀ + r h'ᵀ + m r rᵀ with h' = R h.
        """
        turned = times(R, self.first)
        # half = h' + m r/2: then half rᵀ + r halfᵀ are all three terms of the shift
        half = plus(turned, scaled(0.5, scaled(self.mass, r)))
        pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
        shift = symmetric(*(half[i] * r[j] + r[i] * half[j] for i, j in pairs))
        second = sum_of(congruent(R, self.second), shift)
        return MassDistribution(self.mass, plus(turned, scaled(self.mass, r)), second)


def about_origin(mass: Number, com: Triple, spread: Rows) -> MassDistribution:
    """The moments about the origin, from the mass, its centre and Σ about the centre."""
    first = scaled(mass, com)
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    second = symmetric(*(spread[i][j] + first[i] * com[j] for i, j in pairs))
    return MassDistribution(mass, first, second)


def of_factor(mass: Number, size: Triple, shear: Triple) -> Rows:
    """Σ about the centre: m L Lᵀ with L = [[a, 0, 0], [d, b, 0], [e, f, c]].

    `size` is (a, b, c), each above 0; `shear` is (d, e, f). Σ is positive definite for all values,
    so with a positive mass the body is physically possible. This is the Cholesky factor of the
    pseudo-inertia (Rucker, Wensing: Smooth Parameterization of Rigid-Body Inertia, 2022, section
    III). It is lower instead of upper triangular, with mass and centre as separate parameters.
    """
    (a, b, c), (d, e, f) = size, shear
    rows: tuple[Triple, Triple, Triple] = ((a, 0.0, 0.0), (d, b, 0.0), (e, f, c))
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    return symmetric(*(mass * dot(rows[i], rows[j]) for i, j in pairs))
