"""Reads elements and attributes of a URDF: poses, directions and numbers."""

from __future__ import annotations

import math

from msnn.features.robots import errors
from msnn.features.robots.urdf.geometry import IDENTITY, ZERO, Matrix, Vector, rotation
from msnn.features.robots.urdf.xml_tree import XmlElement
from spec_schema.diagnostics.diagnostic import Findings

LARGEST = 1e30
"""Maximum magnitude in any unit, so that sums of mass times squared length cannot overflow."""


def axis_of(element: XmlElement, what: str, findings: Findings) -> Vector | None:
    """The unit vector of a joint's axis, by default x; None after reporting an error."""
    found = only_element(element, "axis", what, findings)
    if found is None:
        return (1.0, 0.0, 0.0)
    numbers = numbers_of(found, "xyz", 3, what, findings)
    if numbers is None:
        return None
    x, y, z = numbers
    # hypot scales: squares of 1e-200 would vanish
    length = math.hypot(x, y, z)
    if length < 1 / LARGEST:  # which leaves no digits of a direction
        text = found.attributes["xyz"][:40]
        report = errors.malformed_number("xyz", text, "a direction", found.span)
        findings.report(report)
        return None
    return x / length, y / length, z / length


def origin_of(element: XmlElement, what: str, findings: Findings) -> tuple[Matrix, Vector]:
    """Rotation and offset of `<origin xyz rpy>`; identity and 0 without this element."""
    found = only_element(element, "origin", what, findings)
    if found is None:
        return IDENTITY, ZERO
    if "quat_xyzw" in found.attributes:
        findings.report(errors.rotation_as_quaternion(found.span))
    xyz = rpy = ZERO
    if "xyz" in found.attributes:
        x, y, z = numbers_of(found, "xyz", 3, "`<origin>`", findings) or ZERO
        xyz = x, y, z
    if "rpy" in found.attributes:
        roll, pitch, yaw = numbers_of(found, "rpy", 3, "`<origin>`", findings) or ZERO
        rpy = roll, pitch, yaw
    return rotation(*rpy), xyz


def only_element(element: XmlElement, tag: str, what: str, findings: Findings) -> XmlElement | None:
    """The element of a tag that may occur once, or None; repeated elements are reported."""
    found = list(element.all(tag))
    for again in found[1:]:
        said, repair = f"{what} has two `<{tag}>`: which one counts?", "remove one of them"
        findings.report(errors.twice_in_urdf(said, again.span, found[0].span, repair))
    return found[0] if found else None


def attribute_of(element: XmlElement, name: str, what: str, findings: Findings) -> str:
    found = element.attributes.get(name, "")
    if not found:
        findings.report(errors.incomplete_element(what, f"`{name}=…`", element.span))
    return found


def numbers_of(
    element: XmlElement,
    name: str,
    count: int,
    what: str,
    findings: Findings,
    *,
    largest: float = LARGEST,
) -> tuple[float, ...] | None:
    """The `count` values of an attribute, up to `largest`; None after reporting an error."""
    text = element.attributes.get(name)
    if text is None:
        findings.report(errors.incomplete_element(what, f"`{name}=…`", element.span))
        return None
    try:
        # Python would read 1_0 and digits of any script, which no reader of XML takes for numbers
        foreign = "_" in text or not text.isascii()
        # `nan` and `inf` are read here, and the comparison below refuses them
        numbers = () if foreign else tuple(float(part) for part in text.split())
    except ValueError:
        numbers = ()
    if len(numbers) == count and all(abs(number) <= largest for number in numbers):
        return numbers
    wanted = "a number" if count == 1 else f"{count} numbers"
    if any(largest < abs(number) < math.inf for number in numbers):
        wanted += f" up to {largest:g}"
    findings.report(errors.malformed_number(name, text[:40], wanted, element.span))
    return None
