"""Gives masses, places and velocities of the bodies and frames of a robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from msnn.features.robots.dynamics.numbers import (
    NOTHING,
    Number,
    Rows,
    SignedNode,
    Triple,
    congruent,
    cross,
    dot,
    plus,
    scaled,
    sum_of,
    symmetric,
    times,
    transposed,
)
from msnn.features.robots.urdf.robot import WORLD, Body, BodyPoint, Robot

_NO_MOMENTS: Rows = (NOTHING, NOTHING, NOTHING)


@dataclass(frozen=True, slots=True)
class MassDistribution:
    """The moments of a body's mass about the origin of a frame: m, h = ∫ r dm and Σ = ∫ r rᵀ dm
    (`mass`, `first`, `second`), together its pseudo-inertia.

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
        """The same distribution in a parent frame, in which a point x is R x + r.

        Σ' = R Σ Rᵀ + h' rᵀ + r h'ᵀ + m r rᵀ with h' = R h; the new first moment is h' + m r.
        """
        turned = times(R, self.first)
        # half = h' + m r/2: then half rᵀ + r halfᵀ are all three terms of the shift
        half = plus(turned, scaled(0.5, scaled(self.mass, r)))
        pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
        shift = symmetric(*(half[i] * r[j] + r[i] * half[j] for i, j in pairs))
        second = sum_of(congruent(R, self.second), shift)
        return MassDistribution(self.mass, plus(turned, scaled(self.mass, r)), second)


def about_origin(mass: Number, com: Triple, spread: Rows) -> MassDistribution:
    """The moments about the origin from the mass, its centre `com`, and Σ about the centre
    (`spread`).
    """
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


Numbers: TypeAlias = Sequence[Number]
"""One value per body, parents first."""


@dataclass(frozen=True, slots=True)
class Pose:
    """The pose of a body in the frame of its parent: a point x of the body is R x + r there."""

    rotation: Rows
    offset: Triple


@dataclass(frozen=True, slots=True, kw_only=True)
class RigidBodies:
    """A robot with the mass distributions of its bodies, each in the frame of its body."""

    robot: Robot
    masses: tuple[MassDistribution, ...]

    def poses(self, q: Numbers) -> tuple[Pose, ...]:
        """The pose of each body in its parent's frame at the joint positions q, one per body."""
        return tuple(_pose(body, at) for body, at in zip(self.robot.bodies, q, strict=True))


def _pose(body: Body, at: Number) -> Pose:
    x, y, z = zip(*body.rotation, strict=True)
    if body.slides:
        return Pose(body.rotation, plus(body.offset, scaled(at, z)))
    # columns of R Rz(q): a joint's axis is the z of its body's frame
    sine, cosine = _applied("sin", at), _applied("cos", at)
    first = plus(scaled(cosine, x), scaled(sine, y))
    second = plus(scaled(cosine, y), scaled(-sine, x))
    a, b, c = zip(first, second, z, strict=True)
    return Pose((a, b, c), body.offset)


def _applied(function: str, value: Number) -> Number:
    if isinstance(value, SignedNode):
        return value.applied(function)
    return math.sin(value) if function == "sin" else math.cos(value)


Read = Callable[[str, int], Sequence[Number]]
"""Returns the elements of a parameter (`mass`, `com`, `size`, `shear`) of one body with mass, by
its row."""


def with_masses(robot: Robot, read: Read) -> RigidBodies:
    """The bodies of a robot with their mass distributions. Learned quantities are read by `read`
    from the parameters.
    """
    masses = [
        about_origin(body.inertia.mass, body.inertia.com, body.inertia.spread)
        for body in robot.bodies
    ]
    if robot.learned:
        for row, index in enumerate(robot.heavy):
            masses[index] = _learned(robot, index, lambda base, row=row: read(base, row))
    return RigidBodies(robot=robot, masses=tuple(masses))


def _learned(robot: Robot, index: int, read: Callable[[str], Sequence[Number]]) -> MassDistribution:
    """The mass distribution of the body `index` in its own frame, with learned quantities from
    `read`; these refer to the link's axes.

    Quantities that are not learned are constant. If the mass is learned and the inertia is not, the
    moments grow with the mass: the extent of the body stays the same.
    """
    body = robot.bodies[index]
    to_body = transposed(body.axes)
    mass: Number = body.inertia.mass
    com: Triple = body.inertia.com
    if "mass" in robot.learned:
        (mass,) = read("mass")
    if "com" in robot.learned:
        com = times(to_body, _triple(read("com")))
    if "inertia" in robot.learned:
        factor = of_factor(mass, _triple(read("size")), _triple(read("shear")))
        return about_origin(mass, com, congruent(to_body, factor))
    # `heavy` bodies alone come here: their mass in the file is above 0
    growth = mass * (1.0 / body.inertia.mass)
    a, b, c = (scaled(growth, row) for row in body.inertia.spread)
    spread: Rows = (a, b, c)
    return about_origin(mass, com, spread)


def _triple(numbers: Sequence[Number]) -> Triple:
    x, y, z = numbers
    return x, y, z


def position(bodies: RigidBodies, place: BodyPoint, q: Numbers) -> list[Number]:
    """The position x, y, z of a point of a body in the world frame, in m."""
    poses = bodies.poses(q)
    point, body = place.offset, place.body
    # from the body to the base: each pose turns into the parent's frame what is known in its own
    while body != WORLD:
        point = plus(times(poses[body].rotation, point), poses[body].offset)
        body = bodies.robot.bodies[body].parent
    return list(point)


def velocity(bodies: RigidBodies, place: BodyPoint, q: Numbers, dq: Numbers) -> list[Number]:
    """The velocity J(q) dq of a point of a body, along the axes of the world, in m/s."""
    poses = bodies.poses(q)
    tree = bodies.robot.bodies
    line = _line(bodies, place.body)
    spin, speed = NOTHING, NOTHING
    for body in line:
        to_body = transposed(poses[body].rotation)
        # along the axes of the body: Rᵀ (v + ω × r) of what its parent does
        speed = times(to_body, plus(speed, cross(spin, poses[body].offset)))
        x, y, z = times(to_body, spin)
        if tree[body].slides:
            spin, speed = (x, y, z), plus(speed, (0.0, 0.0, dq[body]))
        else:
            spin = (x, y, z + dq[body])
    found: Triple = plus(speed, cross(spin, place.offset))
    for body in reversed(line):
        # a velocity is turned on its way out; offsets would move a place
        found = times(poses[body].rotation, found)
    return list(found)


def _line(bodies: RigidBodies, body: int) -> list[int]:
    """The indices of the bodies on the path from the base to `body`, which is the last."""
    line: list[int] = []
    while body != WORLD:
        line.append(body)
        body = bodies.robot.bodies[body].parent
    return line[::-1]
