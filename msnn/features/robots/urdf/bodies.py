"""Builds the tree of moving bodies of a URDF; links with fixed joints are merged into one body."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from msnn.features.robots import errors
from msnn.features.robots.urdf.elements import LARGEST
from msnn.features.robots.urdf.geometry import (
    IDENTITY,
    ZERO,
    Matrix,
    Vector,
    multiple,
    outer,
    plus,
    product,
    rotation,
    scaled,
    sum_of,
    times,
    to_axis,
    transposed,
)
from msnn.features.robots.urdf.robot import WORLD, Body, BodyPoint, Inertia
from msnn.features.robots.urdf.urdf_file import Joint, Urdf
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span

_AXES: Mapping[str, tuple[bool, Vector]] = {
    "base_x": (True, (1.0, 0.0, 0.0)),
    "base_y": (True, (0.0, 1.0, 0.0)),
    "base_z": (True, (0.0, 0.0, 1.0)),
    "base_yaw": (False, (0.0, 0.0, 1.0)),
    "base_pitch": (False, (0.0, 1.0, 0.0)),
    "base_roll": (False, (1.0, 0.0, 0.0)),
}
"""Joints from the world to the base: True for prismatic ones, and the axis. R is Rz Ry Rx."""


@dataclass(frozen=True, slots=True)
class Tree:
    """The bodies of a robot, parents first, and the frame of each link by name."""

    bodies: tuple[Body, ...]
    links: Mapping[str, _Frame]


@dataclass(frozen=True, slots=True)
class _Frame:
    """The frame of a link: its point x is R x + r in the frame of the body with the
    index `body`.
    """

    body: int
    R: Matrix = IDENTITY
    r: Vector = ZERO

    def joined(self, R: Matrix, r: Vector) -> _Frame:
        """The frame, in the same body, of a link whose point x is R x + r in this frame."""
        return _Frame(self.body, product(self.R, R), plus(times(self.R, r), self.r))

    def place(self) -> BodyPoint:
        return BodyPoint(body=self.body, offset=self.r)


def tree_of(
    urdf: Urdf,
    moving: Sequence[str],
    held: Mapping[str, float],
    *,
    floats: bool,
    findings: Findings,
) -> Tree | None:
    """The tree of bodies that move by the joints named in `moving`; None after reporting errors.

    The other joints are held at the positions in `held`, by default 0 (rad or m). `floats` inserts
    the six joints of a floating base before the root.
    """
    root = _root(urdf, findings)
    if root is None:
        return None
    children: dict[str, list[Joint]] = {}
    for joint in urdf.joints.values():
        children.setdefault(joint.parent, []).append(joint)
    growing = _Growing()
    frame = _Frame(WORLD)
    if floats:
        for name, (slides, axis) in _AXES.items():
            place = urdf.links[root].span
            frame = growing.moved(frame, root, name, axis, place, slides=slides)
    growing.add(root, frame, urdf.links[root].inertia)
    # reversed: the last of the list is taken first, which keeps the order of the file
    waiting = [(joint, frame) for joint in reversed(children.get(root, []))]
    while waiting:
        joint, frame = waiting.pop()
        link = joint.child
        # where the child is while the joint is at 0
        frame = frame.joined(joint.rotation, joint.offset)
        if joint.name in moving:
            slides = joint.type == "prismatic"
            frame = growing.moved(frame, link, joint.name, joint.axis, joint.span, slides=slides)
        elif (position := held.get(joint.name, 0.0)) != 0.0:
            frame = _held(frame, joint, position)
        growing.add(link, frame, urdf.links[link].inertia)
        waiting += [(inner, frame) for inner in reversed(children.get(link, []))]
    return Tree(tuple(growing.bodies), growing.frames)


def _held(frame: _Frame, joint: Joint, position: float) -> _Frame:
    """The frame of a link whose joint is held at `position` (rad or m), from its frame at position
    0.
    """
    if joint.type == "prismatic":
        return frame.joined(IDENTITY, scaled(position, joint.axis))
    A = to_axis(joint.axis)
    return frame.joined(product(product(A, rotation(0.0, 0.0, position)), transposed(A)), ZERO)


class _Growing:
    """Collects bodies and frames of links while the tree is traversed from its root."""

    def __init__(self) -> None:
        self.bodies: list[Body] = []
        self.frames: dict[str, _Frame] = {}

    def moved(
        self, frame: _Frame, link: str, joint: str, axis: Vector, place: Span, *, slides: bool
    ) -> _Frame:
        """Adds a body that moves by a joint along or about `axis` of `frame`; returns the frame of
        its link at joint position 0. `slides` is True for a prismatic joint.
        """
        A = to_axis(axis)
        body = Body(
            link=link,
            joint=joint,
            parent=frame.body,
            slides=slides,
            # the joint's axis becomes z of the body, so that every joint turns about z or slides
            # along it
            rotation=product(frame.R, A),
            offset=frame.r,
            inertia=Inertia(),
            axes=A,
            span=place,
        )
        self.bodies.append(body)
        # turned back: the axes of the link are those of the file, whatever its joint turns about
        return _Frame(len(self.bodies) - 1, transposed(A))

    def add(self, link: str, frame: _Frame, inertia: Inertia) -> None:
        """Stores the frame of a link, and adds its inertia to the body of that frame."""
        self.frames[link] = frame
        # what is fixed to the world never moves: its mass changes nothing
        if frame.body != WORLD and inertia.mass > 0.0:
            body = self.bodies[frame.body]
            whole = _together(body.inertia, _in_body(frame, inertia))
            self.bodies[frame.body] = replace(body, inertia=whole)


def _in_body(frame: _Frame, inertia: Inertia) -> Inertia:
    spread = product(product(frame.R, inertia.spread), transposed(frame.R))
    com = plus(times(frame.R, inertia.com), frame.r)
    return Inertia(mass=inertia.mass, com=com, spread=spread)


def _together(one: Inertia, other: Inertia) -> Inertia:
    """The inertia of two masses together, by Steiner's theorem; an exact copy of `other` if the
    first has no mass.
    """
    if one.mass == 0.0:
        return other
    mass = one.mass + other.mass
    com = scaled(1 / mass, plus(scaled(one.mass, one.com), scaled(other.mass, other.com)))
    spread = sum_of(one.spread, other.spread)
    for part in (one, other):
        away = plus(part.com, scaled(-1.0, com))
        spread = sum_of(spread, multiple(part.mass, outer(away, away)))
    return Inertia(mass=mass, com=com, spread=spread)


def _root(urdf: Urdf, findings: Findings) -> str | None:
    """The name of the only link without a parent; None after reporting that the links
    are no tree.
    """
    above: dict[str, Joint] = {}
    failed = False
    for joint in urdf.joints.values():
        for name in (joint.parent, joint.child):
            if name not in urdf.links:
                failed = True
                what = f"the joint `{joint.name}`"
                findings.report(errors.unknown_link(name, what, joint.span, urdf.links))
        if joint.child in above:
            failed = True
            first = above[joint.child].name
            problem = f"`{joint.child}` is the child of `{first}` and of `{joint.name}`"
            repair = "closed chains are not in this version: cut it open at one joint"
            findings.report(errors.not_a_tree(problem, joint.span, repair))
        above.setdefault(joint.child, joint)
    if failed:
        return None
    roots = [name for name in urdf.links if name not in above]
    if len(roots) > 1:
        problem = f"`{roots[0]}` and `{roots[1]}` hang on nothing"
        place = urdf.links[roots[1]].span
        repair = 'join it by a joint, for example of `type="fixed"`'
        findings.report(errors.not_a_tree(problem, place, repair))
        return None
    loop = _loop(urdf, above)
    if loop is not None:
        problem = f"{' → '.join(loop)} is a loop"
        findings.report(errors.not_a_tree(problem, above[loop[0]].span))
        return None
    return roots[0]


def _loop(urdf: Urdf, above: Mapping[str, Joint]) -> list[str] | None:
    """A cycle of link names, each the parent of the next; None in a tree. `above` is the joint to
    the parent of each link.
    """
    settled: set[str] = set()
    for name in urdf.links:
        line: list[str] = []
        at: str | None = name
        while at is not None and at not in settled:
            if at in line:
                return [*line[line.index(at) :], at][::-1]
            line.append(at)
            at = above[at].parent if at in above else None
        settled.update(line)
    return None


def held_positions(urdf: Urdf, moving: Collection[str], findings: Findings) -> dict[str, float]:
    """The fixed position (rad or m) of each movable joint that is not in `moving`, by name.

    It is 0, for a mimicking joint multiplier · position + offset of its leader. Reports mimicking
    joints whose leader moves.
    """
    found: dict[str, float] = {}
    for joint in urdf.joints.values():
        # a moving joint that mimics is left to be reported: it cannot follow and be driven
        if not joint.moves or (joint.name in moving and joint.mimic is None):
            continue
        position = _position(joint, urdf, moving)
        if position is not None and abs(position) <= LARGEST:
            found[joint.name] = position
        elif position is not None and joint.mimic is not None:
            # along a chain of joints numbers of which each is small enough multiply
            wanted = f"a position up to {LARGEST:g}"
            place = joint.mimic.span
            findings.report(errors.malformed_number("<mimic>", f"{position:g}", wanted, place))
        elif joint.mimic is not None:
            leader = joint.mimic.joint
            # a joint that follows another one cannot be listed either
            others = [
                other.name
                for other in urdf.joints.values()
                if other.name in moving and other.mimic is None and other.name != leader
            ]
            report = errors.mimicking_joint(joint.name, leader, joint.mimic.span, others)
            findings.report(report)
    return found


def _position(joint: Joint, urdf: Urdf, moving: Collection[str]) -> float | None:
    """The fixed position of a joint (rad or m); None if it moves, or if its leader moves or is
    missing.
    """
    factor, position = 1.0, 0.0
    passed: set[str] = set()
    while joint.moves:
        if joint.name in moving or joint.name in passed:
            return None
        if joint.mimic is None:
            return position
        # joints that follow each other in a circle stand nowhere
        passed.add(joint.name)
        # m₁ (m₂ q + o₂) + o₁: offsets further on are multiplied by all factors before them
        position += factor * joint.mimic.offset
        factor *= joint.mimic.multiplier
        leader = urdf.joints.get(joint.mimic.joint)
        if leader is None:
            return None
        joint = leader
    return position
