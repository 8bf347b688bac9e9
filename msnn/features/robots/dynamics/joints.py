"""Computes the pose of each body of a robot in its parent's frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

from msnn.features.robots.dynamics.mass_distribution import MassDistribution
from msnn.features.robots.dynamics.numbers import Number, Rows, SignedNode, Triple, plus, scaled
from msnn.features.robots.urdf.robot import Body, Robot

Numbers: TypeAlias = Sequence[Number]
"""One value per body, parents first."""


@dataclass(frozen=True, slots=True)
class Pose:
    """A point x in the frame of a body is R x + r in the frame of its parent."""

    rotation: Rows
    offset: Triple


@dataclass(frozen=True, slots=True, kw_only=True)
class RigidBodies:
    """A robot with the mass distributions of its bodies, each in the frame of its body."""

    robot: Robot
    masses: tuple[MassDistribution, ...]

    def poses(self, q: Numbers) -> tuple[Pose, ...]:
        """The pose of each body in its parent's frame at joint positions q."""
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
