"""Defines a robot: a tree of moving bodies, each with one joint and a constant inertia."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from msnn.features.robots.urdf.geometry import IDENTITY, ZERO, Matrix, Vector
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass

WORLD = -1
"""The parent of a body at the base."""

BASE_JOINTS = ("base_x", "base_y", "base_z", "base_roll", "base_pitch", "base_yaw")
"""Names of the joints of a floating base, in the order of `q`."""

LEARNED = ("mass", "com", "inertia")
"""The inertial parameters that a robot can learn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Inertia:
    """Mass (kg), its centre c (m), and Σ = ∫ (r − c)(r − c)ᵀ dm (`spread`, kg m²), along the axes
    of a frame.
    """

    mass: float = 0.0
    # Σ and not the moments: any Σ ≥ 0 is that of some body, which is what learning keeps to
    com: Vector = ZERO
    spread: Matrix = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """A body that moves with one joint: a link and all links fixed to it.

    `rotation` and `offset` map points from its frame at joint position 0 to the frame of its
    parent, whose index is `parent`. The joint turns about z of that frame, or slides along it.
    `axes` maps from it to the link's frame in the URDF.
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
    """A point at `offset` in the frame of the body with this index, or of the world."""

    body: int
    offset: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """A tree of bodies, parents first; `positions` has for each body the index of its
    joint in q.
    """

    bodies: tuple[Body, ...]
    positions: tuple[int, ...]
    gravity: Vector
    armature: tuple[float, ...]
    """The armature of each joint, in the order of q."""
    frames: Mapping[str, BodyPoint] = field(default_factory=dict[str, BodyPoint])
    learned: frozenset[str] = frozenset()
    """The learned inertial parameters, a subset of `LEARNED`."""
    joint: str = "joint"
    """Base name of the dimension of q."""

    @property
    def heavy(self) -> tuple[int, ...]:
        """The indices of bodies with mass."""
        # frames of tools and sensors are links without mass, of which nothing can be learned
        return tuple(i for i, body in enumerate(self.bodies) if body.inertia.mass > 0.0)

    @property
    def slides(self) -> bool | None:
        """True if all joints slide, False if none does, None if there are both."""
        kinds = {body.slides for body in self.bodies}
        return kinds.pop() if len(kinds) == 1 else None
