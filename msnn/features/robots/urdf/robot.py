"""Describes a robot: its moving bodies as a tree, each with one joint and a constant inertia."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from msnn.features.robots.urdf.geometry import IDENTITY, ZERO, Matrix, Vector
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass

WORLD = -1
"""The parent of a body that hangs on nothing that moves."""

BASE_JOINTS = ("base_x", "base_y", "base_z", "base_roll", "base_pitch", "base_yaw")
"""Labels of the joints of a floating base, in the order of `q`."""

LEARNED = ("mass", "com", "inertia")
"""What of its inertias a robot can learn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Inertia:
    """Mass, its centre, and Σ = ∫ (r − c)(r − c)ᵀ dm about it, along the axes of a frame."""

    mass: float = 0.0
    # Σ and not the moments: any Σ ≥ 0 is that of some body, which is what learning keeps to
    com: Vector = ZERO
    spread: Matrix = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """A body that moves with one joint: a link with all that is fixed to it.

    `rotation` and `offset` lead from its frame, where the joint is at 0, to that of its parent. The
    joint turns about z of that frame, or slides along it. `axes` lead from it to the link's frame
    as the URDF has it.
    """

    link: str
    joint: str
    parent: int
    slides: bool
    rotation: Matrix
    offset: Vector
    inertia: Inertia
    span: Span = field(compare=False)
    axes: Matrix = IDENTITY


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyPoint:
    """A point that moves with a body, or with nothing."""

    body: int
    offset: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """A tree of bodies, parents first; `positions` are those of their joints in q."""

    bodies: tuple[Body, ...]
    positions: tuple[int, ...]
    gravity: Vector
    armature: tuple[float, ...]
    """Of each joint, in the order of q."""
    frames: Mapping[str, BodyPoint] = field(default_factory=dict[str, BodyPoint])
    learned: frozenset[str] = frozenset()
    """Of `LEARNED`."""
    joint: str = "joint"
    """Base name of the dim of q."""

    @property
    def heavy(self) -> tuple[int, ...]:
        """The bodies that have a mass."""
        # frames of tools and sensors are links without mass, of which nothing can be learned
        return tuple(i for i, body in enumerate(self.bodies) if body.inertia.mass > 0.0)

    @property
    def slides(self) -> bool | None:
        """True if all joints slide, False if none does, None if there are both."""
        kinds = {body.slides for body in self.bodies}
        return kinds.pop() if len(kinds) == 1 else None
