"""Lists the functions of a robot: arguments, axes, unit and algorithm of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from msnn.features.robots.dynamics.mass_matrix import mass_matrix, pivots, solved
from msnn.features.robots.dynamics.newton_euler import joint_forces
from msnn.features.robots.dynamics.numbers import NOTHING, Number
from msnn.features.robots.dynamics.rigid_bodies import RigidBodies, position, velocity
from msnn.features.robots.urdf.robot import BodyPoint

Quantity = Literal["q", "dq", "ddq", "tau", "mass", "place", "speed"]
Along = Literal["joints", "pairs of joints", "space"]
Arguments = Sequence[Sequence[Number]]
"""The elements of each argument, one per body in the order of the bodies."""

UNITS: Mapping[Quantity, tuple[str, str]] = {
    "q": ("rad", "m"),
    "dq": ("rad/s", "m/s"),
    "ddq": ("rad/s^2", "m/s^2"),
    "tau": ("N*m", "N"),
    "mass": ("kg*m^2", "kg"),
    "place": ("m", "m"),
    "speed": ("m/s", "m/s"),
}
"""Units of each quantity for revolute and for prismatic joints."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotMember:
    """A function of a robot: the quantities of its arguments and its result, and the algorithm.

    `compute` returns one element per body, or per pair of bodies, in the order of the bodies.
    """

    arguments: tuple[Quantity, ...]
    result: Quantity
    along: Along = "joints"
    compute: Callable[[RigidBodies, Arguments], Sequence[Number]]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameMember:
    """A function of a frame of a robot; its result is a vector along the axes of the world."""

    arguments: tuple[Quantity, ...]
    result: Quantity
    compute: Callable[[RigidBodies, BodyPoint, Arguments], Sequence[Number]]


def forward_dynamics(
    bodies: RigidBodies, arguments: Arguments, diagonal: Sequence[Number] = ()
) -> list[Number]:
    """The joint accelerations ddq of M(q) ddq + C(q, dq) dq + g(q) = τ; `arguments` are q, dq and
    τ, and M includes the armature on its diagonal.

    `diagonal`, one element per body, is also added to the diagonal of M.
    """
    q, dq, tau = arguments
    matrix = _with_armature(bodies, mass_matrix(bodies, q))
    for index, number in enumerate(diagonal):
        # a number at each joint alone leaves the pattern of zeros as the tree has it
        matrix[index][index] = matrix[index][index] + number
    still = [0.0] * len(q)
    # with ddq = 0 Newton-Euler gives C(q, dq) dq + g(q) at once
    bias = joint_forces(bodies, q, dq, still, bodies.robot.gravity)
    right = [force - other for force, other in zip(tau, bias, strict=True)]
    return solved(bodies, matrix, right)


_SMALLEST_INERTIA = 1e-300
"""In kg m² or kg: smaller inertias have no finite reciprocal."""
_SMALLEST_PIVOT = 1e-12
"""Fraction of a diagonal element of M below which a pivot counts as a rounded 0."""


def undetermined_joint(bodies: RigidBodies) -> int | None:
    """The index of a body whose joint has no inertia in some pose, which makes M singular; None if
    there is none.

    The test uses a generic pose, so masses must be numbers.
    """
    # at 0 or π/2 axes can line up that do so nowhere else
    pose = [0.3 + 0.37 * index for index in range(len(bodies.robot.bodies))]
    matrix = _with_armature(bodies, mass_matrix(bodies, pose))
    diagonal = [matrix[index][index] for index in range(len(matrix))]
    for index, pivot in enumerate(pivots(bodies, matrix)):
        assert isinstance(pivot, float)
        own = diagonal[index]
        assert isinstance(own, float)
        # written so that NaN counts too
        if not pivot > max(_SMALLEST_PIVOT * own, _SMALLEST_INERTIA):
            return index
    return None


def _inverse_dynamics(bodies: RigidBodies, arguments: Arguments) -> list[Number]:
    """The joint torques τ = M(q) ddq + C(q, dq) dq + g(q), M with armature; `arguments` are q, dq
    and ddq.
    """
    q, dq, ddq = arguments
    forces = joint_forces(bodies, q, dq, ddq, bodies.robot.gravity)
    # the inertia of a rotor behind a gear: felt by its own joint alone
    rotors = _armature(bodies)
    return [f + rotor * a for f, rotor, a in zip(forces, rotors, ddq, strict=True)]


def _mass_matrix(bodies: RigidBodies, arguments: Arguments) -> list[Number]:
    """The elements of M(q) with armature, row by row; `arguments` is q alone."""
    lower = _with_armature(bodies, mass_matrix(bodies, arguments[0]))
    count = len(lower)
    return [lower[max(i, j)][min(i, j)] for i in range(count) for j in range(count)]


def _gravity_torque(bodies: RigidBodies, arguments: Arguments) -> list[Number]:
    """g(q): the torques that compensate gravity at rest."""
    (q,) = arguments
    still = [0.0] * len(q)
    return joint_forces(bodies, q, still, still, bodies.robot.gravity)


def _coriolis(bodies: RigidBodies, arguments: Arguments) -> list[Number]:
    """C(q, dq) dq: centrifugal and Coriolis forces; `arguments` are q and dq."""
    q, dq = arguments
    return joint_forces(bodies, q, dq, [0.0] * len(q), NOTHING)


def _armature(bodies: RigidBodies) -> list[float]:
    """The armature of each joint in the order of the bodies."""
    return [bodies.robot.armature[position] for position in bodies.robot.positions]


def _with_armature(bodies: RigidBodies, matrix: list[list[Number]]) -> list[list[Number]]:
    for index, rotor in enumerate(_armature(bodies)):
        matrix[index][index] = matrix[index][index] + rotor
    return matrix


MEMBERS: Mapping[str, RobotMember] = {
    "forward_dynamics": RobotMember(
        arguments=("q", "dq", "tau"), result="ddq", compute=forward_dynamics
    ),
    "inverse_dynamics": RobotMember(
        arguments=("q", "dq", "ddq"), result="tau", compute=_inverse_dynamics
    ),
    "mass_matrix": RobotMember(
        arguments=("q",), result="mass", along="pairs of joints", compute=_mass_matrix
    ),
    "gravity_torque": RobotMember(arguments=("q",), result="tau", compute=_gravity_torque),
    "coriolis": RobotMember(arguments=("q", "dq"), result="tau", compute=_coriolis),
}
"""The functions of a robot by name."""

FRAME_MEMBERS: Mapping[str, FrameMember] = {
    "position": FrameMember(
        arguments=("q",),
        result="place",
        compute=lambda bodies, place, arguments: position(bodies, place, arguments[0]),
    ),
    "jacobian": FrameMember(
        arguments=("q", "dq"),
        result="speed",
        compute=lambda bodies, place, arguments: velocity(bodies, place, *arguments),
    ),
}
"""The functions of a frame by name: position of its origin, and velocity J(q) dq."""
