"""Computes joint forces of a moving robot by the recursive Newton-Euler algorithm."""

from __future__ import annotations

from msnn.features.robots.dynamics.numbers import (
    NOTHING,
    Number,
    Rows,
    Triple,
    cross,
    dot,
    plus,
    scaled,
    times,
    transposed,
)
from msnn.features.robots.dynamics.rigid_bodies import MassDistribution, Numbers, RigidBodies
from msnn.features.robots.urdf.robot import WORLD


def joint_forces(
    bodies: RigidBodies, q: Numbers, dq: Numbers, ddq: Numbers, gravity: Triple
) -> list[Number]:
    """The torque or force of each joint: M(q) ddq + C(q, dq) dq + g(q), without armature. `gravity`
    is the acceleration of free fall in the world frame.

    Computed in the frames of the bodies (Luh, Walker, Paul 1980; Featherstone: Rigid Body Dynamics
    Algorithms, 2008, section 5.3). A body has the angular velocity ω and acceleration α; its origin
    has the acceleration a. A point at r has the acceleration a + B r with B = [α]× + [ω]× [ω]×. The
    force is f = m a + B h with h = ∫ r dm. The moment is n = ∫ r × (a + B r) dm = h × a + (the
    axial vector of B Σ − (B Σ)ᵀ) with Σ = ∫ r rᵀ dm.
    """
    poses = bodies.poses(q)
    tree = bodies.robot.bodies
    spins: list[Triple] = []
    turning: list[Rows] = []
    forces: list[tuple[Triple, Triple]] = []
    accelerations: list[Triple] = []
    # a base that is accelerated upwards: then no body needs a weight of its own
    upwards = scaled(-1.0, gravity)
    angular: list[Triple] = []
    for body, pose, mass, speed, change in zip(tree, poses, bodies.masses, dq, ddq, strict=True):
        to_body = transposed(pose.rotation)
        if body.parent == WORLD:
            spin, twist, pull = NOTHING, NOTHING, times(to_body, upwards)
        else:
            spin = times(to_body, spins[body.parent])
            twist = times(to_body, angular[body.parent])
            # the acceleration, relative to the parent's origin, of the place where the joint is
            moved = times(turning[body.parent], pose.offset)
            pull = times(to_body, plus(accelerations[body.parent], moved))
        x, y, z = spin
        if body.slides:
            # 2 ω × (z v): Coriolis, of a body that slides on one that turns
            pull = plus(pull, (2.0 * y * speed, -2.0 * x * speed, change))
        else:
            # ω × (z dq): the joint's axis is turned by its parent
            twist = plus(twist, (y * speed, -x * speed, change))
            spin = (x, y, z + speed)
        spins.append(spin)
        angular.append(twist)
        accelerations.append(pull)
        turning.append(_turning(spin, twist))
        # of the body alone; what hangs on it adds its own in the sweep back
        forces.append(_force(mass, pull, turning[-1]))
    found: list[Number] = [0.0] * len(tree)
    # outwards speeds, inwards forces: what a body needs its parent must pass on
    for index in reversed(range(len(tree))):
        force, moment = forces[index]
        body, pose = tree[index], poses[index]
        found[index] = force[2] if body.slides else moment[2]
        if body.parent != WORLD:
            outer_force, outer_moment = forces[body.parent]
            force, moment = times(pose.rotation, force), times(pose.rotation, moment)
            moment = plus(moment, cross(pose.offset, force))
            forces[body.parent] = plus(outer_force, force), plus(outer_moment, moment)
    return found


def _turning(spin: Triple, twist: Triple) -> Rows:
    """B = [α]× + [ω]× [ω]× from ω (`spin`) and α (`twist`); B r is the acceleration of a point at r
    relative to the body's origin.
    """
    x, y, z = spin
    a, b, c = twist
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    return (
        (-(yy + zz), xy - c, xz + b),
        (xy + c, -(xx + zz), yz - a),
        (xz - b, yz + a, -(xx + yy)),
    )


def _force(mass: MassDistribution, pull: Triple, B: Rows) -> tuple[Triple, Triple]:
    """The force on a body, and the moment about its origin, for the acceleration `pull` of its
    origin and the matrix B of `_turning`.
    """
    force = plus(scaled(mass.mass, pull), times(B, mass.first))
    first, second, third = mass.second  # of a symmetric matrix: rows are columns
    axial = (
        dot(B[2], second) - dot(B[1], third),
        dot(B[0], third) - dot(B[2], first),
        dot(B[1], first) - dot(B[0], second),
    )
    return force, plus(axial, cross(mass.first, pull))
