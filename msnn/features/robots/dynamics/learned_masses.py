"""Computes the mass distributions of a robot's bodies, partly from learned parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msnn.features.robots.dynamics.joints import RigidBodies
from msnn.features.robots.dynamics.mass_distribution import (
    MassDistribution,
    about_origin,
    of_factor,
)
from msnn.features.robots.dynamics.numbers import Number, Rows, Triple, congruent, scaled, times
from msnn.features.robots.urdf.geometry import transposed
from msnn.features.robots.urdf.robot import Robot

Read = Callable[[str, int], Sequence[Number]]
"""Returns the elements of a parameter (`mass`, `com`, `size`, `shear`) of one body with mass, by
its row."""


def with_masses(robot: Robot, read: Read) -> RigidBodies:
    """The bodies of a robot with their masses; learned ones are read from parameters."""
    masses = [
        about_origin(body.inertia.mass, body.inertia.com, body.inertia.spread)
        for body in robot.bodies
    ]
    if robot.learned:
        for row, index in enumerate(robot.heavy):
            masses[index] = _learned(robot, index, lambda base, row=row: read(base, row))
    return RigidBodies(robot=robot, masses=tuple(masses))


def _learned(robot: Robot, index: int, read: Callable[[str], Sequence[Number]]) -> MassDistribution:
    """The mass distribution of one body in its frame; parameters refer to the link's axes.

    Parts that are not learned are constant: if the mass is learned, the extent of the body stays
    the same, so its moments change.
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
