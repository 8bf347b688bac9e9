"""Computes the fixed positions of joints that a spec does not move: 0, or as `<mimic>` says."""

from __future__ import annotations

from collections.abc import Collection

from msnn.features.robots import errors
from msnn.features.robots.urdf.elements import LARGEST
from msnn.features.robots.urdf.urdf_file import Joint, Urdf
from spec_schema.diagnostics.diagnostic import Findings


def held_positions(urdf: Urdf, moving: Collection[str], findings: Findings) -> dict[str, float]:
    """The position of each movable joint that `moving` omits.

    The position of a mimicking joint is multiplier · position + offset of its leader. Reports
    mimicking joints whose leader moves.
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
    """The position of a joint; None if it moves, or if its leader moves or is missing."""
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
