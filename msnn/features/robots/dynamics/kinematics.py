"""Computes positions and velocities of the frames of a robot."""

from __future__ import annotations

from msnn.features.robots.dynamics.joints import Numbers, RigidBodies
from msnn.features.robots.dynamics.numbers import (
    NOTHING,
    Number,
    Triple,
    cross,
    plus,
    times,
    transposed,
)
from msnn.features.robots.urdf.robot import WORLD, BodyPoint


def position(bodies: RigidBodies, place: BodyPoint, q: Numbers) -> list[Number]:
    """x, y, z of a point of a body, in the world frame."""
    poses = bodies.poses(q)
    point, body = place.offset, place.body
    # from the body to the base: each pose turns into the parent's frame what is known in its own
    while body != WORLD:
        point = plus(times(poses[body].rotation, point), poses[body].offset)
        body = bodies.robot.bodies[body].parent
    return list(point)


def velocity(bodies: RigidBodies, place: BodyPoint, q: Numbers, dq: Numbers) -> list[Number]:
    """J(q) dq: the velocity of a point of a body, along the axes of the world."""
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
    """The bodies on the path from the base to a body."""
    line: list[int] = []
    while body != WORLD:
        line.append(body)
        body = bodies.robot.bodies[body].parent
    return line[::-1]
