"""Computes the mass matrix of a robot from composite bodies, and solves linear systems with it."""

from __future__ import annotations

from msnn.features.robots.dynamics.numbers import Number, Triple, cross, plus, times
from msnn.features.robots.dynamics.rigid_bodies import MassDistribution, Numbers, RigidBodies
from msnn.features.robots.urdf.robot import WORLD

Entries = list[list[Number]]
"""The lower triangle of a matrix, one row per body; structural zeros of the tree stay 0.0."""


def mass_matrix(bodies: RigidBodies, q: Numbers) -> Entries:
    """The lower triangle of M(q) without armature, by the composite rigid body algorithm.

    Element (i, j) of row i is the force at joint j while joint i alone accelerates by 1: the force
    that moves all bodies behind joint i, propagated to the base (Walker, Orin 1982; Featherstone
    2008, section 6.2).
    """
    poses = bodies.poses(q)
    tree = bodies.robot.bodies
    composite = list(bodies.masses)
    matrix: Entries = [[0.0] * (index + 1) for index in range(len(tree))]
    # children stand behind their parents: in reverse, all that hangs on a body is in it by now
    for index in reversed(range(len(tree))):
        body = tree[index]
        force, moment = _of_unit_acceleration(composite[index], slides=body.slides)
        matrix[index][index] = force[2] if body.slides else moment[2]
        if body.parent == WORLD:
            continue
        pose = poses[index]
        composite[body.parent] += composite[index].in_parent(pose.rotation, pose.offset)
        at = index
        # along the line to the base alone: joints of two branches do not couple, their entries stay
        # 0.0
        while tree[at].parent != WORLD:
            force, moment = times(poses[at].rotation, force), times(poses[at].rotation, moment)
            moment = plus(moment, cross(poses[at].offset, force))
            at = tree[at].parent
            matrix[index][at] = force[2] if tree[at].slides else moment[2]
    return matrix


def _of_unit_acceleration(mass: MassDistribution, *, slides: bool) -> tuple[Triple, Triple]:
    """Force and moment that accelerate a mass distribution by 1 along its z axis, if it `slides`,
    or about it.
    """
    # along z a mass at r pulls with (0, 0, 1) and turns with r × that; about z it is accelerated by
    # (−y, x, 0)
    hx, hy, _ = mass.first
    if slides:
        return (0.0, 0.0, mass.mass), (hy, -hx, 0.0)
    (xx, _, xz), (_, yy, yz), _ = mass.second
    return (-hy, hx, 0.0), (-xz, -yz, xx + yy)


def solved(bodies: RigidBodies, matrix: Entries, right: list[Number]) -> list[Number]:
    """The solution x of M x = b; `matrix` is the lower triangle of M, `right` is b, both in the
    order of the bodies.
    """
    parents = [body.parent for body in bodies.robot.bodies]
    factors, pivots_of = _factorised(parents, matrix)
    # one quotient for each joint; all that is left are products, which a processor pipelines
    inverses = [1.0 / pivot for pivot in pivots_of]
    x = list(right)
    # Lᵀ D L x = b: Lᵀ from the leaves to the base, then D, then L back to the leaves
    for i in reversed(range(len(parents))):
        for j in _ancestors(parents, i):
            x[j] = x[j] - factors[i][j] * x[i]
    for i in range(len(parents)):
        x[i] = x[i] * inverses[i]
        for j in _ancestors(parents, i):
            x[i] = x[i] - factors[i][j] * x[j]
    return x


def pivots(bodies: RigidBodies, matrix: Entries) -> list[Number]:
    """The diagonal of D in M = Lᵀ D L: the inertia at each joint if the joints behind
    it are free.
    """
    return _factorised([body.parent for body in bodies.robot.bodies], matrix)[1]


def _factorised(parents: list[int], matrix: Entries) -> tuple[Entries, list[Number]]:
    """L and the diagonal of D in M = Lᵀ D L, computed from the leaves to the base, which preserves
    structural zeros. `parents` are the indices of the bodies' parents.

    See Featherstone 2008, section 6.5. M is positive definite, so rows are not exchanged.
    """
    factors = [list(row) for row in matrix]
    for k in reversed(range(len(parents))):
        above = _ancestors(parents, k)
        if all(isinstance(factors[k][i], float) and factors[k][i] == 0.0 for i in above):
            continue  # nothing couples, and a pivot of 0 is no division by 0
        inverse = 1.0 / factors[k][k]
        slopes = {i: factors[k][i] * inverse for i in above}
        # of the symmetric rest the lower triangle: `above` runs towards the base, so that j ≤ i
        for position, i in enumerate(above):
            for j in above[position:]:
                factors[i][j] = factors[i][j] - slopes[i] * factors[k][j]
        # only now: until here row k is needed as it was
        for i, slope in slopes.items():
            factors[k][i] = slope
    return factors, [factors[k][k] for k in range(len(parents))]


def _ancestors(parents: list[int], body: int) -> list[int]:
    """The parent of a body, its parent and so on up to the base."""
    found: list[int] = []
    while parents[body] != WORLD:
        body = parents[body]
        found.append(body)
    return found
